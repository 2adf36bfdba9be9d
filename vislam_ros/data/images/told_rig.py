# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What messages say of two cameras, and the cameras as those who hear it know them.

A camera info holds the right camera's place as a baseline and two rotations, which rounds. So that
the live graph and ``solve`` see the same bits, both take the cameras as messages tell them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.data.bags.stereo_rig import stereo_rig
from vislam_ros.frontend.rectification import Rectification, common_axes, is_rectified

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InfoFields:
    """Fields of a CameraInfo message, under its names."""

    width: int
    height: int
    distortion_model: str
    d: Array
    k: Array
    r: Array
    p: Array


@dataclass(frozen=True)
class ToldRig:
    """What messages say of a rig.

    Attributes
    ----------
    left, right : InfoFields
        R and P are those of the rectified pair that the front end makes of it.
    position_body_left, quaternion_body_left : ndarray, (3,), (4,)
        Raw left camera in the body: metres; x, y, z, w.
    """

    left: InfoFields
    right: InfoFields
    position_body_left: Array
    quaternion_body_left: Array

    @classmethod
    def of(cls, rig: StereoRig) -> "ToldRig":
        """Put a rig into words; raises a VislamError where it cannot be rectified."""
        camera = Rectification(rig).camera
        turns = [np.eye(3), np.eye(3)]
        if not is_rectified(rig):
            R_rectified_left = common_axes(rig.T_left_right)
            turns = [R_rectified_left, R_rectified_left @ rig.T_left_right[:3, :3]]
        K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        shifts = (0.0, -camera.fx_baseline)
        left, right = (
            _fields(raw, R, np.column_stack([K, [shift, 0.0, 0.0]]))
            for raw, R, shift in zip((rig.left, rig.right), turns, shifts, strict=True)
        )
        R_body_left = se3.nearest_rotation(rig.T_body_left[:3, :3])
        quaternion = se3.quaternion_from_rotation(R_body_left)
        return cls(left, right, rig.T_body_left[:3, 3], quaternion)

    def heard(self) -> StereoRig:
        """Cameras as those know them who hear this."""
        T_body_left = se3.pose_matrix(self.position_body_left, self.quaternion_body_left)
        return stereo_rig(self.left, self.right, T_body_left, rectified=False)


def _fields(raw: RawCamera, R: Array, P: Array) -> InfoFields:
    width, height = raw.image_size
    D = np.asarray(raw.D, dtype=float).ravel()
    return InfoFields(
        width=width,
        height=height,
        distortion_model=raw.distortion_model or "plumb_bob",
        d=D if D.size else np.zeros(5),
        k=np.asarray(raw.K, dtype=float).ravel(),
        r=R.ravel(),
        p=P.ravel(),
    )
