# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the cameras saw: tracks of a drive, and the images where there are some."""

from collections.abc import Iterator

import cv2
import numpy as np

from vislam_ros.data.drive import Drive
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.viewing.stream import TIMELINE, Stream, rerun
from vislam_ros.frontend.grey import GreyStream
from vislam_ros.frontend.rectification import Rectification

PATH = "camera/left"
_JPEG_QUALITY = 85
# Rerun gives each class of points a colour of its own, and knows so many.
_CLASSES = 1 << 16


def log_tracks(stream: Stream, drive: Drive, origin: int) -> None:
    """Log the tracks of each frame in the rectified left image, a colour each.

    Parameters
    ----------
    stream : RecordingStream
    drive : Drive
    origin : int
        Stamp (ns) of the first pose.
    """
    library = rerun()
    counts = np.diff(drive.offsets)
    stream.send_columns(
        f"{PATH}/tracks",
        indexes=[library.TimeColumn(TIMELINE, duration=(drive.feature_stamps - origin) * 1e-9)],
        columns=library.Points2D.columns(
            positions=drive.pixels[:, :2],
            class_ids=(drive.ids % _CLASSES).astype(np.uint16),
            radii=np.full(len(drive.ids), -2.5, dtype=np.float32),  # in pixels of the screen
        ).partition(counts),
    )


def log_images(stream: Stream, images: StereoImages, origin: int) -> Iterator[float]:
    """Log the rectified left images, one in memory at a time; yields the share done.

    Raises
    ------
    VislamError
        Where an image cannot be read.
    """
    library = rerun()
    rectification = Rectification(images.rig)
    left_greys, right_greys = GreyStream(), GreyStream()
    for k, (stamp, left, right) in enumerate(images.pairs(), start=1):
        picture, _ = rectification.rectify(left_greys.grey(*left), right_greys.grey(*right))
        _, content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        stream.set_time(TIMELINE, duration=(stamp - origin) * 1e-9)
        stream.log(PATH, library.EncodedImage(contents=content.tobytes(), media_type="image/jpeg"))
        yield k / len(images)
