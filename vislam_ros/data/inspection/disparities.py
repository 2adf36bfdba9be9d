# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Disparities: which sign they have, and how many no noise explains.

A point that both cameras see lies in front of them, so its disparity is positive, and noise alone
makes that of a far point negative.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding

Array = NDArray[np.float64]

# As the verdict has them: beyond what counts as noise [px], of so many, more than this share.
_CLEAR, _FEWEST, _MOSTLY = 2.0, 50, 0.5
# Standard deviations of noise that one observation in thirty thousand has, on one side.
_BEYOND_NOISE, _BY_CHANCE = 4.0, 3.2e-5
# Standard deviations of the count.
_BEYOND_CHANCE = 4.0


def disparities_of(drive: Drive) -> Array:
    """Disparities (n,) of all observations, pixels."""
    return (drive.pixels[:, 0] - drive.pixels[:, 2]).astype(float)


def are_swapped(disparities: Array) -> bool:
    """Whether most of the disparities (n,) that are clearly one or the other are negative."""
    negative = int(np.sum(disparities < -_CLEAR))
    clear = negative + int(np.sum(disparities > _CLEAR))
    return clear >= _FEWEST and negative > _MOSTLY * clear


def exchanged(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Pixels (n, 4) of the right image in place of the left one's, and the other way round."""
    return pixels[:, [2, 3, 0, 1]]


def swapped(disparities: Array) -> Finding:
    """Finding of a drive whose sides are exchanged, by its disparities (n,) as they are."""
    share = float(np.mean(disparities < 0))
    return Finding(
        "left_right_swapped",
        f"{share:.0%} of the disparities are negative: left and right are exchanged",
        "exchange left and right pixels, or images",
        False,
        {"negative_share": share, "median_px": float(np.median(disparities))},
    )


def judge_disparities(drive: Drive) -> Finding | None:
    """Tell whether more disparities are negative than noise makes so; None where not."""
    disparities = disparities_of(drive)
    n = len(disparities)
    if n < _FEWEST:
        return None
    # Rows tell the noise of a pixel, whatever the depth; they may have been filtered.
    rows = (drive.pixels[:, 1] - drive.pixels[:, 3]).astype(float)
    std = MEDIAN_TO_STD * float(np.median(np.abs(rows - np.median(rows))))
    limit = max(_CLEAR, _BEYOND_NOISE * std)
    negative = int(np.sum(disparities < -limit))
    by_chance = _BY_CHANCE * n
    if negative <= by_chance + _BEYOND_CHANCE * math.sqrt(by_chance) + 1:
        return None
    return Finding(
        "disparities",
        f"{negative / n:.2%} are below -{limit:.1f} px, {disparities.min():.0f} px at worst: "
        "wrong matches",
        "gates keep them out; robocentric takes those about zero",
        True,
        {
            "negative": negative,
            "limit_px": limit,
            "share": negative / n,
            "not_positive_share": float(np.mean(disparities <= 0)),
            "least_px": float(disparities.min()),
        },
    )
