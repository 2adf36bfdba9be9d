# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A SLAM session in a steady state: always the same number of landmarks in view."""

import dataclasses
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.interleaving import cpu_clock
from benchmark.watched_slam import FilterStep, WatchedSlam
from vislam_ros.core.filters.settings import ObservationSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, pixels_of
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.step import SlamStep
from vislam_ros.data.simulation.simulate import BASELINE, INTRINSICS, T_BODY_CAMERA
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

CAMERA = StereoCamera.from_matrices(INTRINSICS, BASELINE, T_BODY_CAMERA)

_PERIOD = 0.1
_FIRST_STAMP = 1_700_000_000 * NANOSECONDS
_PIXEL_STD = 0.5
# A gate that is at work as any other, but so wide that it never changes the number of landmarks.
_GATE = 100.0
_TWIST_STD = np.repeat([0.05, 0.005], 3)
# Where the points are drawn: well inside the image, so that the sway keeps them there.
_LOW, _HIGH = np.array([100.0, 100.0]), np.array([1140.0, 275.0])
_LOG_DISPARITIES = (float(np.log(4.0)), float(np.log(60.0)))


@dataclass(frozen=True)
class SceneFrame:
    """What a session is given for a step."""

    stamp: int
    position: Array
    quaternion: Array
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]


class SwayingScene:
    """A body that sways to and fro before points, of which the oldest give way to new ones.

    Parameters
    ----------
    active : int
        Points in view in every frame.
    seed : int
    """

    def __init__(self, active: int, seed: int = 0):
        self._rng = np.random.default_rng(seed)
        self._step = 0
        self._T_world_body = np.eye(4)
        self._T_odom_body = np.eye(4)
        self._next_id = 0
        self._ids = np.empty(0, dtype=np.uint32)
        self._points: Array = np.empty((0, 3))
        self._replace(active)

    def frame(self, turnover: int) -> SceneFrame:
        """Move on by a step; in its frame turnover of the points are new."""
        phase = 0.3 * self._step
        sway = [0.5 * np.sin(phase), 0.3 * np.sin(1.7 * phase), 0.0]
        turn = [0.002 * np.sin(1.3 * phase), 0.0, 0.02 * np.sin(0.7 * phase)]
        T = se3.exp([*sway, *turn])
        noise = _PERIOD * _TWIST_STD * self._rng.standard_normal(6)
        motion = se3.inverse(self._T_world_body) @ T @ se3.exp(noise)
        self._T_odom_body = self._T_odom_body @ motion
        self._T_world_body = T
        self._ids, self._points = self._ids[turnover:], self._points[turnover:]
        self._replace(turnover)
        T_camera_world = se3.inverse(T @ CAMERA.T_body_camera)
        y = CAMERA.project(self._points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3])
        pixels = pixels_of(y) + _PIXEL_STD * self._rng.standard_normal((len(y), 4))
        stamp = _FIRST_STAMP + round(self._step * _PERIOD * NANOSECONDS)
        self._step += 1
        return SceneFrame(
            stamp,
            self._T_odom_body[:3, 3].copy(),
            se3.quaternion_from_rotation(self._T_odom_body[:3, :3]),
            self._ids.copy(),
            pixels.astype(np.float32),
        )

    def _replace(self, count: int) -> None:
        pixel = self._rng.uniform(_LOW, _HIGH, (count, 2))
        disparity = np.exp(self._rng.uniform(*_LOG_DISPARITIES, count))
        y = np.column_stack([pixel[:, 0], pixel[:, 0] - disparity, pixel[:, 1]])
        T = self._T_world_body @ CAMERA.T_body_camera
        points = CAMERA.triangulate(y) @ T[:3, :3].T + T[:3, 3]
        ids = np.arange(self._next_id, self._next_id + count, dtype=np.uint32)
        self._next_id += count
        self._ids = np.concatenate([self._ids, ids])
        self._points = np.concatenate([self._points, points])


class SteadySession:
    """A session that has been brought to a steady state.

    Parameters
    ----------
    settings : SlamSettings
    active : int
        Landmarks in view.
    turnover : int
        How many of them are new in each step.
    landmarks : int
        How many the map holds at least before the first measured step.
    """

    _STEPS_TO_SETTLE = 20

    def __init__(self, settings: SlamSettings, active: int, turnover: int, landmarks: int = 0):
        self._turnover = turnover
        self._scene = SwayingScene(active)
        self._filter_steps: deque[FilterStep] = deque(maxlen=100)
        if isinstance(settings, ObservationSettings) and settings.chi2_gate > 0:
            settings = dataclasses.replace(settings, chi2_gate=_GATE)
        self._slam = WatchedSlam(settings, self._filter_steps.append)
        self._slam.set_camera(CAMERA)
        self._hear(self._scene.frame(0))  # whose stamp the next one confirms
        self.last = self._take(0)
        # Every point gives way in every second step, so that each is a landmark that was used.
        while self.last.landmarks + active < landmarks:
            self.last = self._take(active)
            self.last = self._take(0)
        for _ in range(self._STEPS_TO_SETTLE):
            self.last = self._take(turnover)

    def step_seconds(self) -> float:
        """Take a step; return the time of all of it, from the message to the estimate."""
        frame = self._scene.frame(self._turnover)
        begin = cpu_clock()
        self.last = self._give(frame)
        return cpu_clock() - begin

    @property
    def filter_median_ms(self) -> float:
        """Median time in the filter of the last hundred steps, without the tracks around it."""
        return float(np.median([step.seconds for step in self._filter_steps])) * 1e3

    @property
    def update_size(self) -> tuple[int, int]:
        """Rows of the last update, and components of the error state that it corrected."""
        filter_step = self._filter_steps[-1]
        before = self.last.active - self.last.admitted + self.last.rejected
        covariance = getattr(self._slam.filter, "covariance", None)
        vehicle = 6 if covariance is None else len(covariance) - 3 * self.last.active
        return 3 * filter_step.outcome.used, vehicle + 3 * before

    def _take(self, turnover: int) -> SlamStep:
        return self._give(self._scene.frame(turnover))

    def _give(self, frame: SceneFrame) -> SlamStep:
        return self._hear(frame)[-1]

    def _hear(self, frame: SceneFrame) -> list[SlamStep]:
        self._slam.add_prediction(frame.stamp, frame.position, frame.quaternion)
        return self._slam.add_features(frame.stamp, frame.ids, frame.pixels)
