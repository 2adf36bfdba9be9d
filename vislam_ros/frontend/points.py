# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of the points that are followed."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.frontend.patches import Patches, cut_patches, joined

Floats = NDArray[np.float32]


@dataclass
class Points:
    """Points as they were last seen, by increasing id.

    Attributes
    ----------
    ids : ndarray of uint32, (n,)
    left : ndarray of float32, (n, 2)
        In the left image, pixels.
    disparities : ndarray of float32, (n,)
        Pixels.
    slopes : ndarray of float32, (n, 2)
        How ``u_right - u_left`` grows along u and v, by the surface's tilt.
    patches : Patches
        Their neighbourhoods where they were begun, or where the view had changed too much.
    maps : ndarray, (n, 2, 2)
        From a step in the image to the step in the patch.
    drift : ndarray of float32, (n,)
        Variance of the place of the patch against the point, of each coordinate [px^2].
    """

    ids: NDArray[np.uint32]
    left: Floats
    disparities: Floats
    slopes: Floats
    patches: Patches
    maps: NDArray[np.float64]
    drift: Floats

    def __len__(self) -> int:
        """Count them."""
        return len(self.ids)

    @classmethod
    def begun(
        cls,
        ids: NDArray[np.uint32],
        image: NDArray[np.uint8],
        left: Floats,
        disparities: Floats,
    ) -> "Points":
        """Points that are new in an image (H, W)."""
        n = len(ids)
        return cls(
            ids,
            left,
            disparities,
            np.zeros((n, 2), np.float32),
            cut_patches(image, left),
            np.tile(np.eye(2), (n, 1, 1)),
            np.zeros(n, np.float32),
        )

    @classmethod
    def none(cls) -> "Points":
        """No points."""
        nothing = np.empty((0, 2), np.float32)
        none = nothing[:, 0]
        ids = np.empty(0, np.uint32)
        return cls(ids, nothing, none, nothing, Patches.none(), np.empty((0, 2, 2)), none)

    @property
    def image_points(self) -> NDArray[np.float64]:
        """``(u_left, u_right, v)``, (n, 3), pixels."""
        u, v = self.left.astype(float).T
        return np.stack([u, u - self.disparities, v], axis=1)

    def __getitem__(self, rows: NDArray[np.bool_]) -> "Points":
        """Those of some rows."""
        return Points(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def with_new(self, new: "Points") -> "Points":
        """Return these and new ones, whose ids are larger."""
        values = {
            field.name: np.concatenate([getattr(self, field.name), getattr(new, field.name)])
            for field in fields(self)
            if field.name != "patches"
        }
        return Points(patches=joined(self.patches, new.patches), **values)

    def cut_anew(
        self, rows: NDArray[np.bool_], image: NDArray[np.uint8], noise: NDArray[np.floating[Any]]
    ) -> None:
        """Take new patches for some, whose places in the image have these variances (n,)."""
        if not rows.any():
            return
        new = cut_patches(image, self.left[rows])
        self.patches.grey[rows], self.patches.fraction[rows] = new.grey, new.fraction
        self.maps[rows] = np.eye(2)
        self.drift[rows] += noise[rows]
