# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths, covariances and the map in the viewer's world."""

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.evaluation.laid_paths import LaidPaths
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.overview import map_covariances
from vislam_ros.data.results.reader import Results
from vislam_ros.data.viewing.stream import TIMELINE, Stream, rerun

Array = NDArray[np.float64]

_COLOURS = {
    "estimate": palette.ESTIMATE,
    "smoothed": palette.SMOOTHED,
    "dead reckoning": palette.DEAD_RECKONING,
    "reference": palette.REFERENCE,
}
# The viewer's ground is dark or bright as the system's is, and this is seen on both.
_ON_BOTH_GROUNDS = {palette.REFERENCE: "#c9a227"}
_SIGMAS = 3.0


def log_world(stream: Stream, results: Results, laid: LaidPaths) -> None:
    """Log all that is known when the run is over.

    Paths and map stand there at every time; the body with its axes, and the ellipsoid of three
    deviations of its position, are where they were.
    """
    library = rerun()
    stream.log("world", library.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for path in laid.paths:
        log_path(stream, path.name, path.positions)
    if results.landmarks is not None:
        log_landmarks(stream, results.landmarks)
    _log_body(stream, results)


def log_path(stream: Stream, name: str, positions: Array) -> None:
    """Log a path (n, 3), metres, in place of one of that name that is there."""
    library = rerun()
    strip = library.LineStrips3D(
        [positions.astype(np.float32)],
        colors=[rgb(_COLOURS[name])],
        radii=library.Radius.ui_points(1.5),
    )
    stream.log(f"world/{name.replace(' ', '_')}", strip, static=True)


def rgb(colour: str) -> list[int]:
    """Red, green and blue of a colour as ``#rrggbb``, readable on the viewer's ground."""
    colour = _ON_BOTH_GROUNDS.get(colour, colour)
    return [int(colour[k : k + 2], 16) for k in (1, 3, 5)]


def landmark_colours(std: Array) -> NDArray[np.uint8]:
    """Colours (n, 3) of deviations (n,), metres: bright where well known, by their logarithm."""
    level = np.log10(np.maximum(std, 1e-6))
    low, high = np.percentile(level, [2, 98])
    share = np.clip((level - low) / max(high - low, 1e-9), 0.0, 1.0)
    return (colormaps["viridis_r"](share)[:, :3] * 255).astype(np.uint8)


def log_landmarks(stream: Stream, landmarks: LandmarkMap) -> None:
    """Log a map in place of the one that is there: points by how well they are known."""
    if not len(landmarks):
        return
    std = np.sqrt(np.maximum(np.linalg.eigvalsh(landmarks.covariances)[:, -1], 0.0))
    library = rerun()
    points = library.Points3D(
        landmarks.positions.astype(np.float32),
        colors=landmark_colours(std),
        radii=library.Radius.ui_points(1.0),
    )
    known = library.AnyValues(std_m=std, id=landmarks.ids)
    stream.log("world/landmarks", points, known, static=True)


def _log_body(stream: Stream, results: Results) -> None:
    library = rerun()
    trajectory = results.trajectory
    seconds = (trajectory.stamps - trajectory.stamps[0]) * 1e-9
    stream.log("world/body", library.TransformAxes3D(2.0), static=True)
    stream.send_columns(
        "world/body",
        indexes=[library.TimeColumn(TIMELINE, duration=seconds)],
        columns=library.Transform3D.columns(
            translation=trajectory.positions, quaternion=trajectory.quaternions
        ),
    )
    covariances = map_covariances(results)
    known = np.flatnonzero(np.isfinite(covariances).all(axis=(1, 2)))
    if not len(known):
        return
    half_sizes, quaternions = ellipsoids(covariances[known])
    stream.send_columns(
        "world/position_covariance",
        indexes=[library.TimeColumn(TIMELINE, duration=seconds[known])],
        columns=library.Ellipsoids3D.columns(
            centers=trajectory.positions[known],
            half_sizes=half_sizes,
            quaternions=quaternions,
            colors=np.tile(rgb(palette.ESTIMATE), (len(known), 1)),
        ),
    )


def ellipsoids(covariances: Array) -> tuple[Array, Array]:
    """Half axes (n, 3) of three deviations, and orientations (n, 4) x, y, z, w, of covariances."""
    values, vectors = np.linalg.eigh(covariances)
    # Axes of eigenvectors may be left-handed, which no rotation is.
    vectors[:, :, 0] *= np.sign(np.linalg.det(vectors))[:, None]
    half_sizes = _SIGMAS * np.sqrt(np.maximum(values, 0.0))
    return half_sizes, se3.quaternion_from_rotation(vectors)
