# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A problem of ours as GTSAM's factors.

GTSAM is an optional dependency (``pip install 'vislam_ros[peers]'``) and imported where it is
used. Its tangent of a pose is ``[theta; rho]``, on the right as ours.
"""

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.peers.problem import PeerProblem
from vislam_ros.core.geometry import se3

Array = NDArray[np.float64]

# The first pose is the origin.
_FIRST_POSE_STD = 1e-4
# Huber's threshold at which 95 % of the efficiency on normal noise is kept.
_HUBER = 1.345
# From ours, [rho; theta], to theirs.
_THEIRS = np.array([3, 4, 5, 0, 1, 2])


@dataclass(frozen=True)
class Recipe:
    """What a graph admits; as text: from how many pixels, and the prior in distances.

    Attributes
    ----------
    min_disparity : float
        A landmark begins with an observation of at least this disparity, pixels.
    depth_prior : float
        Standard deviation of a prior at where a landmark is first triangulated, in parts of its
        distance; 0 is none.
    """

    min_disparity: float
    depth_prior: float = 0.0

    def __str__(self) -> str:
        prior = f", prior {self.depth_prior:g}" if self.depth_prior else ""
        return f"from {self.min_disparity:g} px{prior}"


@dataclass(frozen=True)
class WholeGraph:
    """A graph of all steps, values to begin with, and what it holds."""

    graph: Any
    values: Any
    landmarks: int
    observations: int


class GtsamFactors:
    """Makes GTSAM's factors of a problem.

    Attributes
    ----------
    gtsam : module
    problem : PeerProblem
    """

    def __init__(self, problem: PeerProblem):
        self.gtsam: Any = importlib.import_module("gtsam")
        self.problem = problem
        gtsam, camera = self.gtsam, problem.camera
        self._calibration = gtsam.Cal3_S2Stereo(
            camera.fx, camera.fy, 0.0, camera.cx, camera.cy, camera.baseline
        )
        self._T_body_camera = gtsam.Pose3(camera.T_body_camera)
        self._pixel_noise = gtsam.noiseModel.Robust.Create(
            gtsam.noiseModel.mEstimator.Huber.Create(_HUBER),
            gtsam.noiseModel.Diagonal.Sigmas(problem.pixel_std),
        )

    def pose_key(self, k: int) -> int:
        """Name of the pose of step k."""
        return int(self.gtsam.symbol("x", k))

    def landmark_key(self, key: int) -> int:
        """Name of a landmark."""
        return int(self.gtsam.symbol("l", key))

    def first_pose(self) -> Any:
        """Hold the first pose at the origin."""
        gtsam = self.gtsam
        noise = gtsam.noiseModel.Isotropic.Sigma(6, _FIRST_POSE_STD)
        return gtsam.PriorFactorPose3(self.pose_key(0), gtsam.Pose3(), noise)

    def between(self, k: int, gyro_bias: Array | None) -> Any:
        """Tie the poses of step k and the one before by the twist, less a bias (3,)."""
        gtsam = self.gtsam
        measured = gtsam.Pose3(se3.exp(self.problem.motion(k, gyro_bias)))
        std = self.problem.twist_std * self.problem.durations[k]
        noise = gtsam.noiseModel.Diagonal.Sigmas(std[_THEIRS])
        return gtsam.BetweenFactorPose3(self.pose_key(k - 1), self.pose_key(k), measured, noise)

    def stereo(self, k: int, key: int, point: Array) -> Any:
        """Tie the pose of step k to a landmark by ``u_left, u_right, v`` (3,)."""
        gtsam = self.gtsam
        return gtsam.GenericStereoFactor3D(
            gtsam.StereoPoint2(*point),
            self._pixel_noise,
            self.pose_key(k),
            self.landmark_key(key),
            self._calibration,
            self._T_body_camera,
        )

    def poses(self, values: Any) -> Array:
        """All poses (T, 4, 4) in values."""
        return np.array(
            [values.atPose3(self.pose_key(k)).matrix() for k in range(self.problem.steps)]
        )

    def whole_graph(self, recipe: Recipe, initial: Array, gyro_bias: Array | None) -> WholeGraph:
        """Make the graph of all steps, with poses (T, 4, 4) to begin with.

        A landmark begins where its observation of the largest disparity puts it.
        """
        gtsam, problem = self.gtsam, self.problem
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(self.first_pose())
        for k in range(problem.steps):
            values.insert(self.pose_key(k), gtsam.Pose3(initial[k]))
            if k:
                graph.add(self.between(k, gyro_bias))
        seen: dict[int, list[tuple[int, Array]]] = {}
        for k, (keys, points) in enumerate(problem.observations):
            for key, point in zip(keys.tolist(), points, strict=True):
                seen.setdefault(key, []).append((k, point))
        landmarks = observations = 0
        for key, track in seen.items():
            k, nearest = max(track, key=lambda item: item[1][0] - item[1][1])
            if len(track) < 2 or nearest[0] - nearest[1] < recipe.min_disparity:
                continue
            position = problem.triangulate(initial[k], nearest[None])[0]
            values.insert(self.landmark_key(key), position)
            if recipe.depth_prior:
                graph.add(self.landmark_prior(key, position, initial[k], recipe))
            for step, point in track:
                graph.add(self.stereo(step, key, point))
            landmarks += 1
            observations += len(track)
        return WholeGraph(graph, values, landmarks, observations)

    def landmark_prior(
        self, key: int, position: Array, T_world_body: Array, recipe: Recipe
    ) -> Any:
        """Tie a landmark to where it was first triangulated."""
        gtsam = self.gtsam
        distance = float(np.linalg.norm(position - T_world_body[:3, 3]))
        noise = gtsam.noiseModel.Isotropic.Sigma(3, recipe.depth_prior * distance)
        return gtsam.PriorFactorPoint3(self.landmark_key(key), position, noise)


class GraphGrowth:
    """Makes, step by step, what is new to a graph.

    A landmark enters with its second observation, for one alone says nothing of the poses.

    Parameters
    ----------
    factors : GtsamFactors
    recipe : Recipe
    gyro_bias : ndarray, (3,), or None
        To be taken from the twists, rad/s.
    memory : int
        Steps for which an observation is kept until its landmark enters.

    Attributes
    ----------
    factors : GtsamFactors
    observations : int
        In the graph so far.
    """

    def __init__(
        self, factors: GtsamFactors, recipe: Recipe, gyro_bias: Array | None, memory: int
    ):
        self.factors = factors
        self._recipe = recipe
        self._gyro_bias = gyro_bias
        self._memory = memory
        self._waiting: dict[int, list[tuple[int, Array]]] = {}
        self._entered: set[int] = set()
        self.observations = 0

    @property
    def landmarks(self) -> int:
        """Number of landmarks that have entered."""
        return len(self._entered)

    def step(self, k: int, T_before: Array) -> tuple[Any, Any, list[int]]:
        """Return new factors, new values and the keys that step k touches."""
        factors, gtsam, problem = self.factors, self.factors.gtsam, self.factors.problem
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        touched = [factors.pose_key(k)]
        if k == 0:
            T_world_body = np.eye(4)
            graph.add(factors.first_pose())
        else:
            T_world_body = T_before @ se3.exp(problem.motion(k, self._gyro_bias))
            graph.add(factors.between(k, self._gyro_bias))
        values.insert(factors.pose_key(k), gtsam.Pose3(T_world_body))
        keys, points = problem.observations[k]
        far = points[:, 0] - points[:, 1] < self._recipe.min_disparity
        positions = np.zeros_like(points)
        positions[~far] = problem.triangulate(T_world_body, points[~far])
        for i, key in enumerate(keys.tolist()):
            if key in self._entered:
                graph.add(factors.stereo(k, key, points[i]))
                self.observations += 1
                touched.append(factors.landmark_key(key))
                continue
            seen = self._waiting.setdefault(key, [])
            seen.append((k, points[i]))
            recent = [past for past in seen if past[0] > k - self._memory]
            if far[i] or len(recent) < 2:
                continue
            self._entered.add(key)
            del self._waiting[key]
            for j, point in recent:
                graph.add(factors.stereo(j, key, point))
            self.observations += len(recent)
            values.insert(factors.landmark_key(key), positions[i])
            if self._recipe.depth_prior:
                graph.add(factors.landmark_prior(key, positions[i], T_world_body, self._recipe))
            touched.append(factors.landmark_key(key))
        return graph, values, touched
