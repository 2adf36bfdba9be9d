# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A whole result in the viewer."""

from collections.abc import Callable

from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.laid_paths import laid_paths
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.pictures.charts import charts_of
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.viewing.frames import log_images, log_tracks
from vislam_ros.data.viewing.layout import send_layout
from vislam_ros.data.viewing.series import log_charts
from vislam_ros.data.viewing.stream import Stream
from vislam_ros.data.viewing.world import log_world


def log_results(
    stream: Stream,
    results: Results,
    reference: Trajectory | None = None,
    *,
    drive: Drive | None = None,
    images: StereoImages | None = None,
    progress: Callable[[float], object] = lambda share: None,
) -> None:
    """Log a result directory, and what the cameras saw where it is at hand.

    Parameters
    ----------
    stream : RecordingStream
        See :func:`vislam_ros.data.viewing.stream.opened_stream`.
    results : Results
    reference : Trajectory, optional
        The truth: its path, and errors with three deviations.
    drive : Drive, optional
        The tracks that were solved.
    images : StereoImages, optional
        The images that they were tracked in.
    progress : callable, optional
        Told the share of the images that is done, 0 to 1.

    Raises
    ------
    VislamError
        Where the reference is of another drive, or an image cannot be read.
    """
    charts = charts_of(results, reference)
    send_layout(stream, charts, with_frames=drive is not None)
    log_world(stream, results, laid_paths(results, reference))
    log_charts(stream, charts)
    origin = int(results.trajectory.stamps[0])
    if drive is not None:
        log_tracks(stream, drive, origin)
    if images is not None:
        for share in log_images(stream, images, origin):
            progress(share)
