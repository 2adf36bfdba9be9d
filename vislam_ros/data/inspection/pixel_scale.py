# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the pixels are those of images of another size than the intrinsics'.

Images are halved to track faster, and the intrinsics stay. Two things tell: the middle of what is
seen, which should be about the principal point, and the motion, by which points go where they are
seen only if the intrinsics are the images'. The first names the size, the second confirms it:
with the pixels multiplied by it, the points of a step must be off by less than half, in the same
pixels.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.verdict.image_motion import image_motion
from vislam_ros.data.datasets.mending import inverted
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding

Array = NDArray[np.float64]

# What is seen is not even: its middle is off by up to a fifth. Sizes nearer to 1 than this are no
# other size.
_LEAST = 1.3
# Of the principal point's two numbers each has to tell a size, within this factor of the other's.
_ALIKE = 1.6
# Shares of the pixels beyond which they do not count, per cent.
_EDGES = (1.0, 99.0)
_FEWEST_PIXELS = 200
# Sizes that are usual, as fractions; others are taken as they are.
_USUAL = np.array([1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2, 3, 4])
_NEAR_USUAL = 1.12
_STEPS, _FEWEST_STEPS, _FEWEST_POINTS = 120, 8, 8
_LEFT = np.array([0, 2])
_MIN_DISPARITY = 1.0
_LEAST_FLOW = 0.5


def judge_pixel_scale(drive: Drive) -> Finding | None:
    """Tell by what the pixels should be multiplied; None where by nothing."""
    scale = scale_by_the_middle(drive)
    if scale is None:
        return None
    # Extrinsics that are inverted, too, must not hide it.
    told = [
        each
        for camera in (drive.camera, inverted(drive.camera))
        if (each := _errors(replace(drive, camera=camera), (1.0, scale))) is not None
    ]
    errors = np.min(told, axis=0) if told else None
    if errors is not None and not errors[1] < 0.5 * errors[0]:
        return None
    is_outside = _shows_a_corner(drive)
    if errors is None and not is_outside:
        return None
    numbers = {"scale": scale, "principal_point": [drive.camera.cx, drive.camera.cy]}
    if errors is not None:
        numbers["off_px"] = errors.tolist()
    return Finding(
        "pixel_scale",
        f"pixels are those of images {1.0 / scale:.3g} times as large as the intrinsics'",
        f"multiply the pixels by {scale:.3g}, or K by {1.0 / scale:.3g}",
        False,
        numbers,
    )


def scale_by_the_middle(drive: Drive) -> float | None:
    """What would put the middle of the pixels on the principal point; None where both are."""
    if len(drive.pixels) < _FEWEST_PIXELS:
        return None
    low, high = np.percentile(drive.pixels[:, :2].astype(float), _EDGES, axis=0)
    middle = 0.5 * (low + high)
    if not np.all(middle > 0):
        return None
    ratios = np.array([drive.camera.cx, drive.camera.cy]) / middle
    if abs(math.log(ratios[0] / ratios[1])) > math.log(_ALIKE):
        return None
    # Columns are seen to both edges; of rows the sky may be missing.
    scale = float(ratios[0])
    if abs(math.log(scale)) < math.log(_LEAST):
        return None
    usual = float(_USUAL[np.argmin(np.abs(np.log(_USUAL / scale)))])
    return usual if abs(math.log(usual / scale)) < math.log(_NEAR_USUAL) else scale


def _shows_a_corner(drive: Drive) -> bool:
    """Whether the principal point is out of nearly all that is seen, in both directions."""
    camera, pixels = drive.camera, drive.pixels
    shares = (np.mean(pixels[:, 0] < camera.cx), np.mean(pixels[:, 1] < camera.cy))
    return all(share > 0.9 for share in shares) or all(share < 0.1 for share in shares)


def _errors(drive: Drive, scales: tuple[float, ...]) -> Array | None:
    """By how much the points of a step are off, median over steps, in the drive's pixels.

    The turn is the gyroscope's, the rest what fits; or the twist's where there are velocities.
    """
    stamps = drive.feature_stamps
    if drive.steps < 2 or not len(drive.twists):
        return None
    found: list[list[float]] = []
    for k in np.unique(np.linspace(0, drive.steps - 2, _STEPS).astype(int)).tolist():
        j = int(np.searchsorted(drive.twist_stamps, stamps[k + 1]))
        if j >= len(drive.twists):
            continue
        _, before, after = drive.followed(k)
        z, z_after = before.astype(float), after.astype(float)
        near = z[:, 0] - z[:, 2] > _MIN_DISPARITY
        z, z_after = z[near], z_after[near]
        if len(z) < _FEWEST_POINTS or np.median(np.abs(z - z_after)) < _LEAST_FLOW:
            continue
        tau = float(stamps[k + 1] - stamps[k]) * 1e-9
        found.append([_off(drive, scale, z, z_after, tau, drive.twists[j]) for scale in scales])
    if len(found) < _FEWEST_STEPS:
        return None
    return np.asarray(np.median(np.array(found), axis=0))


def _off(drive: Drive, scale: float, z: Array, z_after: Array, tau: float, twist: Array) -> float:
    camera = _shrunk(drive.camera, scale)
    y, y_after = (np.ascontiguousarray(each[:, [0, 2, 1]]) for each in (z, z_after))
    if np.isfinite(twist).all():
        T = camera.T_camera_body @ se3.exp(-tau * twist) @ camera.T_body_camera
    else:
        R = camera.T_camera_body[:3, :3]
        T = image_motion(camera, y, y_after, np.eye(4)).T_new_old.copy()
        T[:3, :3] = R @ se3.exp_rotation(-tau * twist[3:]) @ R.T
    with np.errstate(all="ignore"):
        e = (camera.warp(y, T) - y_after)[:, _LEFT]
    return float(np.median(np.linalg.norm(np.nan_to_num(e, nan=1e6, posinf=1e6), axis=1)))


def _shrunk(camera: StereoCamera, scale: float) -> StereoCamera:
    """Camera of images whose pixels, multiplied, are those of the one given."""
    return replace(
        camera,
        fx=camera.fx / scale,
        fy=camera.fy / scale,
        cx=camera.cx / scale,
        cy=camera.cy / scale,
        fx_baseline=camera.fx_baseline / scale,
    )
