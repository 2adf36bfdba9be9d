# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the right camera's principal point is as the calibration says, along the rows.

Off by some pixels it shifts all disparities alike: no row shows it, far points come too near or
beyond infinity, and the baseline or the axes look wrong in its stead. What shows it are depths
that do not fit the motion, where those of the left camera's principal point do.
"""

from dataclasses import replace
from typing import NamedTuple

from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.data.datasets.conventions import CLEARLY_SMALLER
from vislam_ros.data.finding import Finding


class PrincipalPoints(NamedTuple):
    """Of the right camera as the file has it, and of the left one: their columns, pixels."""

    right: float
    left: float

    def finding(self, error: float, error_of_left: float) -> Finding | None:
        """Tell what is off; None where the left one's fits no better.

        Parameters
        ----------
        error, error_of_left : float
            One-step reprojection errors with either, pixels; infinite where too few points have a
            depth.
        """
        if not error_of_left < CLEARLY_SMALLER * error:
            return None
        told = f"{error:.2f} px" if error < float("inf") else "no depth at all"
        return Finding(
            "right_camera",
            f"cx of K_r is {self.right:.6g} px beside {self.left:.6g} of K_l: the images fit with "
            f"that of K_l ({error_of_left:.2f} px off, for {told})",
            "check K_r",
            False,
            {"cx_right": self.right, "cx_left": self.left, "error_px": error_of_left},
        )


def with_left_column(
    rectification: PixelRectification | None,
) -> tuple[PixelRectification, PrincipalPoints] | None:
    """Rectification as if cx of the right camera were that of the left one; None where it is."""
    right = None if rectification is None else rectification.right
    if rectification is None or right is None or right.before.cx == right.after.cx:
        return None
    before = right.before._replace(cx=right.after.cx)
    points = PrincipalPoints(right.before.cx, right.after.cx)
    return replace(rectification, right=replace(right, before=before)), points
