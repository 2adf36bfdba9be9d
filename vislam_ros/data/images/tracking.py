# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The front end offline: a drive in images to a drive in tracks."""

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.datasets.conventions import settle_conventions
from vislam_ros.data.datasets.sparse_features import Progress
from vislam_ros.data.drive import Drive
from vislam_ros.data.images.stereo_images import Motion, StereoImages
from vislam_ros.errors import VislamError
from vislam_ros.frontend.grey import GreyStream
from vislam_ros.frontend.rectification import Rectification
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import StereoTracker

Array = NDArray[np.float64]


def tracked_drive(
    images: StereoImages,
    settings: TrackerSettings | None = None,
    progress: Progress | None = None,
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
    motion = images.motion
    if motion is None or not images.timed:
        what = "the motion" if motion is None else "the times of the images"
        # A reader may have refused all of it.
        skipped = "".join(f" ({note.rstrip('.')})" for note in images.notes if "Skipped" in note)
        raise VislamError(
            f"{images.name}: nothing tells {what}: give a dataset or a bag that does with "
            f"--motion{skipped}"
        )
    motion = motion.during(images.stamps)
    rectification = Rectification(images.rig)
    camera = rectification.camera
    tracker = StereoTracker(camera, rectification.image_size, settings or TrackerSettings())
    # A camera's images are scaled alike, those of 16 bits.
    left_greys, right_greys = GreyStream(), GreyStream()
    R_camera_body = camera.T_camera_body[:3, :3]
    ids: list[NDArray[np.uint32]] = [np.empty(0, dtype=np.uint32)]
    pixels: list[NDArray[np.float32]] = [np.empty((0, 4), dtype=np.float32)]
    noise: list[NDArray[np.float32]] = [np.empty(0, dtype=np.float32)]
    before: int | None = None
    for k, (stamp, left, right) in enumerate(images.pairs(), start=1):
        turn = None
        if before is not None and images.unsettled is None:
            turn = turn_between(motion, before, stamp)
        R_now_before = None if turn is None else R_camera_body @ turn.T @ R_camera_body.T
        rectified = rectification.rectify(left_greys.grey(*left), right_greys.grey(*right))
        tracked = tracker.track(*rectified, R_now_before)
        ids.append(tracked.ids)
        pixels.append(tracked.pixels)
        noise.append(tracked.noise)
        before = stamp
        if progress is not None:
            progress(k / len(images))
    drive = Drive(
        name=images.name,
        camera=camera,
        image_size=rectification.image_size,
        twist_stamps=motion.stamps,
        twists=motion.twists,
        feature_stamps=images.stamps,
        offsets=np.cumsum([len(each) for each in ids], dtype=np.int64),
        ids=np.concatenate(ids),
        pixels=np.concatenate(pixels),
        noise=np.concatenate(noise),
        ground_truth=images.ground_truth,
        notes=images.notes,
    )
    if images.unsettled is None or not np.array_equal(drive.twist_stamps, drive.feature_stamps):
        return drive
    return settle_conventions(drive, images.unsettled)


def turn_between(motion: Motion, begin: int, end: int) -> Array | None:
    """Rotation (3, 3) of the body from one stamp to a later one, in the axes of the first.

    A sample stands for the time that ends at its stamp, so the last one may reach beyond ``end``.

    Parameters
    ----------
    motion : Motion
    begin, end : int
        Nanoseconds.

    Returns
    -------
    ndarray or None
        None where the motion does not reach over the whole time.
    """
    if begin < motion.stamps[0] or end > motion.stamps[-1]:
        return None
    first = int(np.searchsorted(motion.stamps, begin, side="right"))
    last = int(np.searchsorted(motion.stamps, end, side="left"))
    knots = np.concatenate([[begin], motion.stamps[first:last], [end]])
    durations = np.diff(knots) * 1e-9
    turns = se3.exp_rotation(durations[:, None] * motion.twists[first : last + 1, 3:])
    R = np.eye(3)
    for turn in turns:
        R = R @ turn
    return R
