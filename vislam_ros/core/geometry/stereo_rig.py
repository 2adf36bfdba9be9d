# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two cameras as they stand on a body, before their images are rectified."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: What a lens can be, in the names of ROS: none, radial and tangential (4 or 5 numbers), rational
#: (8), and Kannala and Brandt's for wide lenses (4).
DISTORTION_MODELS = ("", "plumb_bob", "rational_polynomial", "equidistant")


#: How many coefficients each of them can have.
COEFFICIENTS = {"": (0,), "plumb_bob": (4, 5), "rational_polynomial": (8,), "equidistant": (4,)}


def without_idle_zeros(distortion_model: str, D: Array) -> Array:
    """Coefficients (n,) without zeros at the end that go beyond those of the model.

    OpenCV's calibrations have up to 14 numbers; those of a thin prism and of a tilt are zeros
    where nobody asked for them.
    """
    most = max(COEFFICIENTS.get(distortion_model, (D.size,)))
    return D if np.any(D[most:]) else D[:most]


@dataclass(frozen=True)
class RawCamera:
    """One camera with its lens, in the terms of a CameraInfo message.

    Attributes
    ----------
    image_size : tuple of int, (2,)
        Width and height, pixels.
    K : ndarray, (3, 3)
        Intrinsics of the raw image, pixels.
    distortion_model : str
        One of :data:`DISTORTION_MODELS`.
    D : ndarray, (n,)
        Its coefficients; none where the image has no distortion.
    """

    image_size: tuple[int, int]
    K: Array
    distortion_model: str
    D: Array


@dataclass(frozen=True)
class StereoRig:
    """A stereo pair on a body, with any lenses and a small angle between the cameras.

    Attributes
    ----------
    left, right : RawCamera
    T_left_right : ndarray, (4, 4)
        Pose of the right optical frame in the left one; its translation is metres.
    T_body_left : ndarray, (4, 4)
        Pose of the left raw optical frame in the body (IMU) frame.
    """

    left: RawCamera
    right: RawCamera
    T_left_right: Array
    T_body_left: Array
