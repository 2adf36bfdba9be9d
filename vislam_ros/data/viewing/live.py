# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A run in the viewer while it goes on, from what the recorder has written so far."""

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from vislam_ros.core.geometry import se3
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.charts import Chart
from vislam_ros.data.results.growing import GrowingStep
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.data.viewing.layout import send_layout
from vislam_ros.data.viewing.stream import TIMELINE, Stream, rerun
from vislam_ros.data.viewing.world import ellipsoids, log_landmarks, log_path, rgb
from vislam_ros.errors import VislamError

# Path and map are sent whole: once a second, as often as the recorder renews the map.
_RENEW_SECONDS = 1.0

_CHARTS = {
    "landmarks": {name: name for name in ("observed", "active", "used", "rejected")},
    "step_ms": {"step": "ms"},
    "gyro_bias": {axis: f"gyro_bias_{axis}" for axis in "xyz"},
}
_TITLES = {
    "landmarks": "landmarks",
    "nis": "NIS / dof",
    "step_ms": "time a step [ms]",
    "position_std": f"{palette.SIGMA} of the position [m]",
    "gyro_bias": "gyro bias [rad/s]",
}


class LiveViewer:
    """Logs a growing result directory; the entities are those of a whole one.

    Parameters
    ----------
    stream : RecordingStream
    """

    def __init__(self, stream: Stream):
        self._stream = stream
        self._origin: int | None = None
        self._positions: list[np.ndarray] = []
        self._renewed = -np.inf
        send_layout(
            stream, [Chart(key, title) for key, title in _TITLES.items()], with_frames=False
        )
        stream.log("world", rerun().ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log("world/body", rerun().TransformAxes3D(2.0), static=True)

    def add(self, directory: Path, steps: Sequence[GrowingStep]) -> None:
        """Log steps that are new in a directory; another pass stands in another one."""
        if not steps:
            return
        if self._origin is None:
            self._origin = steps[0].stamp
        seconds = np.array([(step.stamp - self._origin) * 1e-9 for step in steps])
        self._log_body(seconds, steps)
        self._log_series(seconds, steps)
        self._positions += [step.position for step in steps]
        if time.monotonic() - self._renewed >= _RENEW_SECONDS:
            self.renew(directory)

    def renew(self, directory: Path) -> None:
        """Log path and map as they stand."""
        self._renewed = time.monotonic()
        if self._positions:
            log_path(self._stream, "estimate", np.array(self._positions))
        path = directory / "landmarks.npz"
        # It comes with the first map, and is replaced while we look.
        if path.exists():
            with suppress(VislamError):
                log_landmarks(self._stream, read_landmarks(path))

    def begin_pass(self) -> None:
        """Forget the path: the next step is of another pass."""
        self._origin, self._positions = None, []

    def _log_body(self, seconds: np.ndarray, steps: Sequence[GrowingStep]) -> None:
        library = rerun()
        index = [library.TimeColumn(TIMELINE, duration=seconds)]
        positions = np.array([step.position for step in steps])
        quaternions = np.array([step.quaternion for step in steps])
        self._stream.send_columns(
            "world/body",
            indexes=index,
            columns=library.Transform3D.columns(translation=positions, quaternion=quaternions),
        )
        R = se3.rotation_from_quaternion(quaternions)
        covariances = np.array([step.covariance[:3, :3] for step in steps])
        covariances = R @ covariances @ np.swapaxes(R, 1, 2)
        half_sizes, axes = ellipsoids(covariances)
        self._stream.send_columns(
            "world/position_covariance",
            indexes=index,
            columns=library.Ellipsoids3D.columns(
                centers=positions,
                half_sizes=half_sizes,
                quaternions=axes,
                colors=np.tile(rgb(palette.ESTIMATE), (len(steps), 1)),
            ),
        )
        std = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
        for axis, column in zip("xyz", std.T, strict=True):
            self._log_scalars(f"position_std/{axis}", seconds, column)

    def _log_series(self, seconds: np.ndarray, steps: Sequence[GrowingStep]) -> None:
        for key, lines in _CHARTS.items():
            for name, column in lines.items():
                if column in steps[0].row:
                    values = np.array([step.row[column] for step in steps])
                    self._log_scalars(f"{key}/{name}", seconds, values)
        dof = np.array([step.row["nis_dof"] for step in steps])
        nis = np.array([step.row["nis"] for step in steps])
        if (dof > 0).any():
            self._log_scalars("nis/each_step", seconds[dof > 0], nis[dof > 0] / dof[dof > 0])

    def _log_scalars(self, path: str, seconds: np.ndarray, values: np.ndarray) -> None:
        library = rerun()
        self._stream.send_columns(
            f"series/{path}",
            indexes=[library.TimeColumn(TIMELINE, duration=seconds)],
            columns=library.Scalars.columns(scalars=values),
        )
