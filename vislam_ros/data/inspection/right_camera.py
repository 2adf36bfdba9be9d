# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether the right camera is as the calibration says: both images see a point in one row.

To first order, a right image of other focal length, turned about its axis, or shifted up, makes
the rows of a pair differ by a plane in the image point, ``a + b x + c y``, and a right camera that
stands higher by one in proportion to the disparity. A focal length that is off by c pixels moves
the columns by c x, too, which no row shows: so what counts is how far both move the right pixel.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding
from vislam_ros.data.inspection.disparities import (
    are_swapped,
    disparities_of,
    exchanged,
    swapped,
)

Array = NDArray[np.float64]

# Rectified pairs that are known to be right are off by 0.1 to 0.3 pixels [px].
_OFF = 0.5
_BEYOND_CHANCE = 4.0
_FEWEST_TRACKS = 20
_ENOUGH_PIXELS = 50_000  # more of them are known no better, for what their tracks have wrong stays
# Residuals count up to this many standard deviations, in so many rounds.
_TUKEY, _ROUNDS = 4.685, 10
_LEAST_STD = 0.02  # pixels: rounding


def judge_pairs(drive: Drive) -> list[Finding]:
    """Tell what pairs of pixels alone show: exchanged sides, and a right camera that is off."""
    found = []
    disparities = disparities_of(drive)
    if are_swapped(disparities):
        found.append(swapped(disparities))
        drive = replace(drive, pixels=exchanged(drive.pixels))
    right = judge_right_camera(drive)
    return found if right is None else [*found, right]


def judge_right_camera(drive: Drive) -> Finding | None:
    """Tell whether right pixels are off; None where not, or where too few tracks tell."""
    rows = np.arange(0, len(drive.pixels), max(1, len(drive.pixels) // _ENOUGH_PIXELS))
    camera, pixels, ids = drive.camera, drive.pixels[rows].astype(float), drive.ids[rows]
    if len(np.unique(ids)) < _FEWEST_TRACKS:
        return None
    difference = pixels[:, 3] - pixels[:, 1]
    x = (pixels[:, 2] - camera.cx) / camera.fx
    y = (pixels[:, 3] - camera.cy) / camera.fy
    depth = (pixels[:, 0] - pixels[:, 2]) / camera.fx
    A = np.column_stack([np.ones(len(x)), x, y, depth])
    coefficients, weights, std = _robust(A, difference)
    covariance = _covariance(A, difference - A @ coefficients, weights, ids)
    # How far the right pixel is moved: rows as fitted, columns by focal length and turn.
    parts = np.stack([A, np.column_stack([np.zeros(len(x)), -y, x, np.zeros(len(x))])], axis=1)
    used = weights > 0
    M = np.einsum("nki,nkj->ij", parts[used], parts[used]) / max(int(used.sum()), 1)
    square = float(coefficients @ M @ coefficients)
    off = math.sqrt(square)
    gradient = M @ coefficients / max(off, 1e-12)
    error = math.sqrt(float(gradient @ covariance @ gradient))
    if off - _BEYOND_CHANCE * error < _OFF:
        return None
    focal, turn = float(coefficients[2]), math.degrees(float(coefficients[1]) / camera.fx)
    return Finding(
        "right_camera",
        f"right pixels are off by {off:.1f} px: rows by {np.median(difference):+.1f}, the focal "
        f"length by {focal:+.1f}",
        "calibrate the pair: K_r and the turn between the cameras",
        False,
        {
            "off_px": off,
            "std_px": error,
            "rows_px": float(coefficients[0]),
            "focal_length_px": focal,
            "roll_deg": turn,
            "upward_share_of_baseline": float(coefficients[3]) / camera.fx,
            "scatter_px": std,
        },
    )


def corrected(drive: Drive, finding: Finding) -> Drive:
    """Drive with its right pixels where the finding says they should be."""
    camera, pixels, numbers = drive.camera, drive.pixels.astype(float), finding.numbers
    x = (pixels[:, 2] - camera.cx) / camera.fx
    y = (pixels[:, 3] - camera.cy) / camera.fy
    turn = camera.fx * math.radians(numbers["roll_deg"])
    depth = (pixels[:, 0] - pixels[:, 2]) * numbers["upward_share_of_baseline"]
    pixels[:, 2] -= numbers["focal_length_px"] * x - turn * y
    pixels[:, 3] -= numbers["rows_px"] + turn * x + numbers["focal_length_px"] * y + depth
    return replace(drive, pixels=pixels.astype(np.float32))


def _robust(A: Array, b: Array) -> tuple[Array, Array, float]:
    """Solve ``A x = b`` with Tukey's weights; x, the weights (n,) and the scatter."""
    weights: Array = np.ones(len(b))
    # The slope may hide in the rows' scatter at first.
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        x: Array = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0].astype(float)
        residuals = b - A @ x
        std = max(MEDIAN_TO_STD * float(np.median(np.abs(residuals))), _LEAST_STD)
        weights = np.maximum(1.0 - (residuals / (_TUKEY * std)) ** 2, 0.0) ** 2
    return x, weights, std


def _covariance(A: Array, residuals: Array, weights: Array, ids: NDArray[np.uint32]) -> Array:
    """Covariance of x, where what belongs to one track errs alike."""
    inverse = np.linalg.pinv((A * weights[:, None]).T @ A)
    scores = A * (weights * residuals)[:, None]
    _, track = np.unique(ids, return_inverse=True)
    sums = np.zeros((int(track.max()) + 1, A.shape[1]))
    np.add.at(sums, track, scores)
    return np.asarray(inverse @ (sums.T @ sums) @ inverse)
