# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a file that reading does not repair, undone: to tell what else is wrong with it."""

from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.datasets.sparse_features import DenseFeatures
from vislam_ros.data.finding import Finding

Array = NDArray[np.float64]

_EXCHANGED = [2, 3, 0, 1]


@dataclass(frozen=True)
class Mending:
    """What is undone when a file is read.

    Attributes
    ----------
    swaps_sides : bool
        Left and right pixels are exchanged.
    pixel_scale : float
        What the pixels are multiplied by.
    inverts_extrinsics : bool
    mends_stamps : bool
        Stamps that do not fit to most of the others are put between their neighbours.
    """

    swaps_sides: bool = False
    pixel_scale: float = 1.0
    inverts_extrinsics: bool = False
    mends_stamps: bool = False

    def features(self, features: DenseFeatures) -> DenseFeatures:
        """Observations, mended."""
        pixels = features.pixels
        if self.swaps_sides:
            pixels = pixels[:, _EXCHANGED]
        if self.pixel_scale != 1.0:
            pixels = pixels * self.pixel_scale
        return features if pixels is features.pixels else replace(features, pixels=pixels)

    def camera(self, camera: StereoCamera) -> StereoCamera:
        """Camera, mended."""
        return inverted(camera) if self.inverts_extrinsics else camera


#: Nothing is undone.
AS_STORED = Mending()


def inverted(camera: StereoCamera) -> StereoCamera:
    """Camera whose extrinsics map the other way."""
    T = camera.T_camera_body
    x, y, z = T[:3, 3].tolist()
    qx, qy, qz, qw = se3.quaternion_from_rotation(T[:3, :3]).tolist()
    return replace(camera, position_body_camera=(x, y, z), quaternion_body_camera=(qx, qy, qz, qw))


def mended_stamps(stamps: NDArray[np.int64]) -> tuple[NDArray[np.int64], Finding | None]:
    """Put stamps that are out of order between their neighbours.

    Those are right that make the longest increasing sequence (Fredman, *On computing the length of
    longest increasing subsequences*, 1975): the fewest have to be wrong.

    Parameters
    ----------
    stamps : ndarray of int64, (n,)
        Nanoseconds.

    Returns
    -------
    ndarray of int64, (n,)
        Strictly increasing where more than half of them are right.
    Finding or None
        None where all increase.
    """
    right = _longest_increasing(stamps)
    wrong = np.setdiff1d(np.arange(len(stamps)), right)
    if not len(wrong):
        return stamps, None
    period = np.median(np.diff(stamps[right])) if len(right) > 1 else 1e8
    offset = stamps[right[0]]
    # In rows before the first right one and after the last, the period goes on.
    between = np.interp(
        np.arange(len(stamps)),
        np.concatenate([[right[0] - 1e6], right, [right[-1] + 1e6]]),
        np.concatenate(
            [
                [-1e6 * period],
                (stamps[right] - offset).astype(float),
                [float(stamps[right[-1]] - offset) + 1e6 * period],
            ]
        ),
    )
    result = stamps.copy()
    result[wrong] = offset + between[wrong].astype(np.int64)
    return result, Finding(
        "stamps",
        f"{len(wrong)} of {len(stamps)} stamps are not later than those before, the first in row "
        f"{wrong[0]}",
        "put the rows in order, or give the stamps anew: solve refuses them",
        False,
        {"out_of_order": len(wrong), "rows": wrong[:20].tolist()},
    )


def _longest_increasing(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places of the longest strictly increasing subsequence."""
    tails: list[int] = []
    places: list[int] = []
    before = np.full(len(stamps), -1)
    for k, stamp in enumerate(stamps.tolist()):
        at = bisect_left(tails, stamp)
        before[k] = places[at - 1] if at else -1
        tails[at : at + 1] = [stamp]
        places[at : at + 1] = [k]
    chain, k = [], places[-1]
    while k >= 0:
        chain.append(k)
        k = int(before[k])
    return np.array(chain[::-1], dtype=np.int64)
