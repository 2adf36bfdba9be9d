# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The front end offline: a drive in images to a drive in tracks."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.datasets.conventions import settle_conventions
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.images.told_rig import ToldRig
from vislam_ros.frontend.pair_tracker import PairTracker
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import Tracked

OnPair = Callable[[NDArray[np.uint8], Tracked], None]


def tracked_drive(
    images: StereoImages,
    settings: TrackerSettings | None = None,
    progress: Progress | None = None,
    on_pair: OnPair | None = None,
) -> Drive:
    """Track features through images, one pair in memory at a time.

    Where nothing has told yet which axes the twists have and which steps, the tracks tell it.

    Parameters
    ----------
    images : StereoImages
        With their motion.
    settings : TrackerSettings, optional
    progress : callable, optional
        Told the share done, 0 to 1.
    on_pair : callable, optional
        Called with the rectified left image (H, W) of each pair, and what was seen in it.

    Returns
    -------
    Drive
        With the camera of the rectified images, the noise that the front end states, and the
        motion in the time of the images.

    Raises
    ------
    VislamError
        Where nothing tells the motion or the times, or an image cannot be read.
    """
    motion = images.known_motion()
    turning = images.turns or motion
    rig = images.rig if images.is_of_graph else ToldRig.of(images.rig).heard()
    tracker = PairTracker(rig, settings)
    stamps: list[int] = []
    ids: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
    pixels: list[NDArray[np.float32]] = [np.empty((0, 4), dtype=np.float32)]
    noise: list[NDArray[np.float32]] = [np.empty(0, dtype=np.float32)]
    before: int | None = None
    for k, (stamp, left, right) in enumerate(images.pairs(), start=1):
        turn = None
        if before is not None and images.unsettled is None:
            turn = turning.turn_between(before, stamp)
        tracked = tracker.track(left, right, turn)
        before = stamp
        if on_pair is not None and tracker.left is not None:
            on_pair(tracker.left, tracked)
        if not tracked.repeated:
            stamps.append(stamp)
            ids.append(tracked.ids)
            pixels.append(tracked.pixels)
            noise.append(tracked.noise)
        if progress is not None:
            progress(k / len(images))
    notes = images.notes
    if repeated := len(images) - len(stamps):
        notes = (*notes, f"Left out {repeated} pairs with an image over again.")
    drive = Drive(
        name=images.name,
        camera=tracker.camera,
        image_size=tracker.image_size,
        twist_stamps=motion.stamps,
        twists=motion.twists,
        accelerations=motion.accelerations,
        feature_stamps=np.array(stamps, dtype=np.int64),
        offsets=np.cumsum([len(each) for each in ids], dtype=np.int64),
        ids=np.concatenate(ids),
        pixels=np.concatenate(pixels),
        noise=np.concatenate(noise),
        ground_truth=images.ground_truth,
        notes=notes,
    )
    if images.unsettled is None or not np.array_equal(drive.twist_stamps, drive.feature_stamps):
        return drive
    return settle_conventions(drive, images.unsettled)
