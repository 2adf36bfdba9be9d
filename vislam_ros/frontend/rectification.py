# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rectification: images as if two equal cameras without distortion had taken them side by side.

The rectified axes have x along the baseline and z as near to both cameras' as that allows. Their
one focal length fills the image with what both cameras see, without black corners, and a pair
that is rectified already passes through bit for bit.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.stereo_rig import (
    COEFFICIENTS,
    DISTORTION_MODELS,
    RawCamera,
    StereoRig,
)
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Tables = tuple[NDArray[Any], NDArray[Any]]

# A pair whose rows and axes agree to this is rectified [px].
_RECTIFIED = 1e-3
# Widest ray along each axis, as a tangent: 55 degrees to each side. A corner then lies 63 degrees
# off the axis, beyond which the filter follows no point (core.geometry.warp).
_WIDEST = math.sqrt(2.0)
# Samples of each border of an image.
_SAMPLES = 33
# How far the baseline may be from the left camera's x axis, as a cosine: 45 degrees.
_SIDEWAYS = math.sqrt(0.5)


class Rectification:
    """Rectifies the pairs of a rig.

    Parameters
    ----------
    rig : StereoRig

    Raises
    ------
    VislamError
        If the cameras do not stand side by side, left one left, or a calibration makes no sense.
    """

    def __init__(self, rig: StereoRig):
        _check(rig.left, "left")
        _check(rig.right, "right")
        t = rig.T_left_right[:3, 3]
        baseline = float(np.linalg.norm(t))
        if not (np.isfinite(rig.T_left_right).all() and np.isfinite(rig.T_body_left).all()):
            raise VislamError("T_left_right or T_body_left: is not finite")
        if not t[0] > _SIDEWAYS * baseline:
            raise VislamError(
                f"T_left_right: the right camera stands at {np.round(t, 4).tolist()} m, not "
                "to the right of the left one; are the two exchanged, or is it the inverse?"
            )
        self._rig = rig
        self._passes = is_rectified(rig)
        if self._passes:
            self._camera = StereoCamera.from_matrices(rig.left.K, baseline, rig.T_body_left)
            return
        R_rectified_left = common_axes(rig.T_left_right)
        turns = R_rectified_left, R_rectified_left @ rig.T_left_right[:3, :3]
        K = _common_intrinsics((rig.left, rig.right), turns)
        T_left_rectified = np.eye(4)
        T_left_rectified[:3, :3] = R_rectified_left.T
        self._camera = StereoCamera.from_matrices(K, baseline, rig.T_body_left @ T_left_rectified)
        self._maps = [
            _maps(raw, R, K, rig.left.image_size)
            for raw, R in zip((rig.left, rig.right), turns, strict=True)
        ]

    @property
    def camera(self) -> StereoCamera:
        """Camera of the rectified images."""
        return self._camera

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the rectified images, pixels: the raw left ones'."""
        return self._rig.left.image_size

    def rectify(self, left: Grey, right: Grey) -> tuple[Grey, Grey]:
        """Rectify a pair.

        Parameters
        ----------
        left, right : ndarray of uint8, (H, W)

        Returns
        -------
        tuple of ndarray of uint8, (H, W)
            Black where the raw images do not reach.

        Raises
        ------
        VislamError
            If an image does not have the size of its calibration.
        """
        for name, image, raw in (
            ("left", left, self._rig.left),
            ("right", right, self._rig.right),
        ):
            width, height = raw.image_size
            if image.shape != (height, width) or image.dtype != np.uint8:
                raise VislamError(
                    f"{name} image: is {image.shape} of {image.dtype}, but its calibration is for "
                    f"grey images of {width} x {height} pixels"
                )
        if self._passes:
            return left, right
        (left_maps, right_maps) = self._maps
        return (
            np.asarray(cv2.remap(left, *left_maps, cv2.INTER_LINEAR), np.uint8),
            np.asarray(cv2.remap(right, *right_maps, cv2.INTER_LINEAR), np.uint8),
        )


def is_rectified(rig: StereoRig) -> bool:
    """Tell whether the images of a rig are rectified as they are."""
    left, right = rig.left, rig.right
    focal = max(left.K[0, 0], left.K[1, 1])
    t = rig.T_left_right[:3, 3]
    off = (
        np.abs(left.K - right.K).max(),
        np.abs(rig.T_left_right[:3, :3] - np.eye(3)).max() * focal,
        np.abs(t[1:]).max() / np.linalg.norm(t) * focal,
        abs(left.K[0, 1]),
    )
    distorted = any(_is_distorted(camera) for camera in (left, right))
    return not distorted and left.image_size == right.image_size and max(off) < _RECTIFIED


def _is_distorted(camera: RawCamera) -> bool:
    # Of the equidistant model, all zeros is a fisheye lens, not a pinhole.
    return camera.distortion_model == "equidistant" or bool(np.any(camera.D != 0))


def _check(camera: RawCamera, name: str) -> None:
    if camera.distortion_model not in DISTORTION_MODELS:
        known = ", ".join(model for model in DISTORTION_MODELS if model)
        raise VislamError(
            f"{name} camera: distortion model {camera.distortion_model!r} is not known; use one "
            f"of {known}"
        )
    D = np.asarray(camera.D, dtype=float)
    counts = COEFFICIENTS[camera.distortion_model]
    if camera.distortion_model and D.size not in counts:
        raise VislamError(
            f"{name} camera: {camera.distortion_model} has {D.size} coefficients, not "
            + " or ".join(map(str, counts))
        )
    if not camera.distortion_model and np.any(D != 0):
        raise VislamError(f"{name} camera: has coefficients and no distortion model; name it")
    K = np.asarray(camera.K, dtype=float)
    if not (K.shape == (3, 3) and np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        raise VislamError(f"{name} camera: K {K.tolist()} has no positive focal lengths")
    if not np.isfinite(D).all():
        raise VislamError(f"{name} camera: D {D.tolist()} is not finite")


def common_axes(T_left_right: Array) -> Array:
    """Rotation (3, 3) from left to rectified axes: x along the baseline, z between the two z."""
    x = T_left_right[:3, 3] / np.linalg.norm(T_left_right[:3, 3])
    between = np.array([0.0, 0.0, 1.0]) + T_left_right[:3, 2]
    y = np.cross(between, x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def _common_intrinsics(cameras: tuple[RawCamera, RawCamera], turns: tuple[Array, Array]) -> Array:
    """Intrinsics (3, 3) whose image, as large as the left one, both cameras fill."""
    seen = np.array([_seen(*pair) for pair in zip(cameras, turns, strict=True)])
    left, top = np.maximum(seen[:, :2].max(axis=0), -_WIDEST)
    right, bottom = np.minimum(seen[:, 2:].min(axis=0), _WIDEST)
    if not (left < right and top < bottom):
        raise VislamError("T_left_right: the two cameras see nothing in common")
    width, height = cameras[0].image_size
    focal = max((width - 1) / (right - left), (height - 1) / (bottom - top))
    cx = (width - 1) / 2 - focal * (left + right) / 2
    cy = (height - 1) / 2 - focal * (top + bottom) / 2
    return np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])


def _seen(camera: RawCamera, R: Array) -> tuple[float, float, float, float]:
    """Largest upright rectangle of rays, left top right bottom, inside an image's borders."""
    width, height = camera.image_size
    across, down = np.linspace(0, width - 1, _SAMPLES), np.linspace(0, height - 1, _SAMPLES)
    borders = [
        np.stack([np.zeros(_SAMPLES), down], 1),
        np.stack([across, np.zeros(_SAMPLES)], 1),
        np.stack([np.full(_SAMPLES, width - 1.0), down], 1),
        np.stack([across, np.full(_SAMPLES, height - 1.0)], 1),
    ]
    left, top, right, bottom = (_rays(camera, border, R) for border in borders)
    return (
        float(left[:, 0].max()),
        float(top[:, 1].max()),
        float(right[:, 0].min()),
        float(bottom[:, 1].min()),
    )


def _rays(camera: RawCamera, pixels: Array, R: Array) -> Array:
    """Rectified rays (n, 2) of depth 1 of raw pixels (n, 2), no wider than half a turn allows."""
    if camera.distortion_model == "equidistant":
        return _fisheye_rays(camera, pixels, R)
    rays = cv2.undistortPoints(pixels.reshape(-1, 1, 2), camera.K, _coefficients(camera), R=R)
    return np.asarray(rays, dtype=float).reshape(-1, 2)


def _fisheye_rays(camera: RawCamera, pixels: Array, R: Array) -> Array:
    # Only to the widest ray: beyond it the tangent grows without bound, and changes its sign.
    x = (pixels[:, 0] - camera.K[0, 2]) / camera.K[0, 0]
    y = (pixels[:, 1] - camera.K[1, 2]) / camera.K[1, 1]
    distorted = np.hypot(x, y)
    angles = np.linspace(0, math.atan(2 * _WIDEST), 500)
    k1, k2, k3, k4 = np.asarray(camera.D, dtype=float)
    square = angles**2
    radii = angles * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    angle = np.interp(distorted, np.maximum.accumulate(radii), angles)
    scale = np.tan(angle) / np.maximum(distorted, 1e-12)
    rays = np.stack([x * scale, y * scale, np.ones_like(x)], 1) @ R.T
    return rays[:, :2] / rays[:, 2:]


def _maps(camera: RawCamera, R: Array, K: Array, size: tuple[int, int]) -> Tables:
    """Tables of cv2.remap for a camera."""
    make = (
        cv2.fisheye.initUndistortRectifyMap
        if camera.distortion_model == "equidistant"
        else cv2.initUndistortRectifyMap
    )
    first, second = make(camera.K, _coefficients(camera), R, K, size, cv2.CV_16SC2)
    return np.asarray(first), np.asarray(second)


def _coefficients(camera: RawCamera) -> Array:
    """Distortion, as OpenCV takes it; none is four zeros."""
    D = np.asarray(camera.D, dtype=float).ravel()
    return D if D.size else np.zeros(4)
