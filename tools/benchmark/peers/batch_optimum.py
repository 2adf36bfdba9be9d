# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The batch optimum: all poses, landmarks and the gyroscope's bias at their likeliest values.

A filter linearises each observation once. What that costs is seen beside the estimate that goes
back over all observations until nothing moves any more, by Gauss and Newton. Its cost is

    sum_ij rho(|| V^-1/2 (z_ij - w(y_j, T_a^-1 T_i)) ||)
      + 1/2 sum_i || (u_i - [0; b] - v_i) / sigma ||^2
      + 1/2 sum_i || (v_i - v_{i-1}) / (sigma_walk sqrt(tau_i)) ||^2,

with ``v_i = Log(T_{i-1}^-1 T_i) / tau_i``: a landmark's image point ``y_j`` in the frame ``a``
that saw it first (an inverse depth, as in the robocentric filter), the warp ``w``, the measured
twists ``u_i``, Huber's loss rho. The third sum is the robocentric filter's idea of motion, and
may be left out. The first pose is the identity. Landmarks are eliminated one by one (Schur
complement), which leaves a dense system of poses and bias.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from benchmark.peers.problem import PeerProblem
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.warp import warp

Array = NDArray[np.float64]

# Huber's threshold on the length of an observation's residual in standard deviations. Of normal
# ones with three components, three in a hundred are longer.
_HUBER = 3.0
# A step that raises the cost is halved this often.
_HALVINGS = 10


@dataclass(frozen=True)
class BatchState:
    """What is estimated.

    Attributes
    ----------
    T_world_body : ndarray, (T, 4, 4)
        The first is the identity.
    gyro_bias : ndarray, (3,)
        Radians a second.
    image_points : ndarray, (M, 3)
        ``u_left, u_right, v`` of each landmark in the frame that saw it first, pixels.
    """

    T_world_body: Array
    gyro_bias: Array
    image_points: Array


@dataclass(frozen=True)
class BatchResult:
    """Where the search ended.

    Attributes
    ----------
    state : BatchState
    costs : tuple of float
        At the start and after each iteration.
    converged : bool
        Whether the last iteration moved all poses by less than the tolerance.
    """

    state: BatchState
    costs: tuple[float, ...]
    converged: bool


@dataclass(frozen=True)
class Residuals:
    """Observations against a state; derivatives of the prediction where they were asked for.

    Attributes
    ----------
    residual : ndarray, (n, 3)
        Observed less predicted, in standard deviations.
    weight : ndarray, (n,)
        Huber's; 0 for a point behind the camera.
    by_point : ndarray, (n, 3, 3)
        By the landmark's image point.
    by_pose, by_anchor : ndarray, (n, 3, 6)
        By the errors on the right of the pose that sees it and of the one that saw it first.
    """

    residual: Array
    weight: Array
    by_point: Array
    by_pose: Array
    by_anchor: Array


@dataclass(frozen=True)
class TwistResiduals:
    """Twists against a state: those measured, and where it counts, their walk.

    Attributes
    ----------
    residual : tuple of ndarray, (n, 6) each
        Measured less predicted, in standard deviations.
    derivative : tuple of ndarray, (n, 6, m) each
        Of the prediction.
    places : tuple of ndarray of int64, (n, m) each
        By which errors: 6 for each pose, the first among them, then 3 of the bias.
    """

    residual: tuple[Array, ...]
    derivative: tuple[Array, ...]
    places: tuple[NDArray[np.int64], ...]


class BatchProblem:
    """The optimisation problem of all steps at once.

    Parameters
    ----------
    problem : PeerProblem
        Its landmarks with a single observation say nothing and are left out.
    twist_walk_std : ndarray, (6,), optional
        Random walk of the body's twist, m/s/sqrt(s) and rad/s/sqrt(s). Without it nothing is
        known of how fast a twist may change.

    Attributes
    ----------
    steps, landmarks, observations : int
        The latter of these landmarks.
    landmark_of, step_of : ndarray of int64, (n,)
        Of each observation; by landmark, and of each landmark by step.
    anchor_of : ndarray of int64, (M,)
        Of each landmark, the step that saw it first.
    """

    def __init__(self, problem: PeerProblem, twist_walk_std: Array | None = None):
        self._problem = problem
        self._twist_walk_std = twist_walk_std
        self.steps = problem.steps
        keys = np.concatenate([keys for keys, _ in problem.observations])
        points = np.concatenate([points for _, points in problem.observations])
        step = np.repeat(np.arange(self.steps), [len(keys) for keys, _ in problem.observations])
        _, landmark, count = np.unique(keys, return_inverse=True, return_counts=True)
        several = count > 1
        rows = np.flatnonzero(several[landmark])
        rows = rows[np.lexsort((step[rows], landmark[rows]))]
        self.landmark_of = (np.cumsum(several) - 1)[landmark[rows]]
        self.step_of = step[rows]
        self._observed = points[rows]
        self._ends = np.cumsum(count[several])
        self._first = self._ends - count[several]
        self.anchor_of = self.step_of[self._first]
        self.landmarks, self.observations = len(self._first), len(rows)
        self._again = self.step_of != self.anchor_of[self.landmark_of]

    def start(self, T_world_body: Array) -> BatchState:
        """State with these poses (T, 4, 4), no bias and each landmark where it was first seen."""
        T = se3.inverse(T_world_body[0]) @ T_world_body
        return BatchState(T, np.zeros(3), self._observed[self._first].copy())

    def moved(self, state: BatchState, delta: Array, scale: float = 1.0) -> BatchState:
        """State after a step ``[xi_1; ...; xi_{T-1}; delta b; delta y_1; ...]``."""
        poses, bias, points = np.split(
            scale * delta, [6 * (self.steps - 1), 6 * (self.steps - 1) + 3]
        )
        T = state.T_world_body.copy()
        T[1:] = T[1:] @ se3.exp(poses.reshape(-1, 6))
        return BatchState(T, state.gyro_bias + bias, state.image_points + points.reshape(-1, 3))

    def cost(self, state: BatchState) -> float:
        """Half the sum of squared residuals, where they are beyond Huber's threshold less."""
        seen = self.residuals(state)
        length = np.sqrt(np.sum(seen.residual**2, axis=1))
        loss = np.where(length < _HUBER, 0.5 * length**2, _HUBER * (length - 0.5 * _HUBER))
        # A landmark behind the camera may not be free of cost.
        loss[seen.weight == 0] = 0.5 * _HUBER**2
        of_twists = sum(np.sum(part**2) for part in self.twist_residuals(state).residual)
        return float(np.sum(loss) + 0.5 * of_twists)

    def residuals(self, state: BatchState) -> Residuals:
        """Observations against a state, with derivatives."""
        problem = self._problem
        T_first_now = self._motions(state)
        seen = warp(problem.camera, state.image_points[self.landmark_of], T_first_now)
        residual = (self._observed - seen.y) / problem.pixel_std
        length = np.sqrt(np.sum(residual**2, axis=1))
        # Where a landmark was first seen it does not depend on the pose.
        by_pose = np.where(self._again[:, None, None], seen.G, 0.0)
        by_anchor = -by_pose @ se3.adjoint(se3.inverse(T_first_now))
        scale = problem.pixel_std[:, None]
        return Residuals(
            residual=residual,
            weight=seen.ahead.astype(float) * np.minimum(1.0, _HUBER / np.maximum(length, _HUBER)),
            by_point=seen.F_y / scale,
            by_pose=by_pose / scale,
            by_anchor=by_anchor / scale,
        )

    def twist_residuals(self, state: BatchState) -> TwistResiduals:
        """Measured twists, and the walk from each twist to the next, against a state."""
        problem, n = self._problem, self.steps - 1
        tau = problem.durations[1:, None]
        T_step = se3.inverse(state.T_world_body[:-1]) @ state.T_world_body[1:]
        motion = se3.log(T_step)
        by_after = np.linalg.inv(np.array([se3.right_jacobian(xi) for xi in motion]))
        by_before = -by_after @ se3.adjoint(se3.inverse(T_step))
        by_pair = np.concatenate([by_before, by_after], axis=-1) / tau[..., None]
        twist = motion / tau
        bias = np.concatenate([np.zeros(3), state.gyro_bias])

        measured = problem.motions[1:] / tau
        by_measured = np.zeros((n, 6, 15))
        by_measured[:, :, :12] = by_pair
        by_measured[:, 3:, 12:] = np.eye(3)
        pairs = 6 * np.arange(n)[:, None] + np.arange(12)
        of_bias = np.broadcast_to(6 * self.steps + np.arange(3), (n, 3))
        residual = [(measured - twist - bias) / problem.twist_std]
        derivative = [by_measured / problem.twist_std[:, None]]
        places = [np.concatenate([pairs, of_bias], axis=1)]
        if self._twist_walk_std is not None:
            std = self._twist_walk_std * np.sqrt(tau[1:])
            by_walk = np.zeros((n - 1, 6, 18))
            by_walk[:, :, 6:] = by_pair[1:]
            by_walk[:, :, :12] -= by_pair[:-1]
            residual.append((twist[:-1] - twist[1:]) / std)
            derivative.append(by_walk / std[..., None])
            places.append(6 * np.arange(n - 1)[:, None] + np.arange(18))
        return TwistResiduals(tuple(residual), tuple(derivative), tuple(places))

    def newton_step(self, state: BatchState) -> Array:
        """Solve the normal equations: the step that :meth:`moved` takes."""
        size = 6 * self.steps + 3
        normal, right = np.zeros((size, size)), np.zeros(size)
        self._add_twists(state, normal, right)
        seen = self.residuals(state)
        weight, r = seen.weight[:, None, None], seen.residual[..., None]
        by_point_T = weight * np.swapaxes(seen.by_point, 1, 2)
        by_pose_T = weight * np.swapaxes(seen.by_pose, 1, 2)
        by_anchor_T = weight * np.swapaxes(seen.by_anchor, 1, 2)

        for blocks, rights, steps in (
            (by_pose_T @ seen.by_pose, by_pose_T @ r, self.step_of),
            (
                self._by_landmark(by_anchor_T @ seen.by_anchor),
                self._by_landmark(by_anchor_T @ r),
                self.anchor_of,
            ),
        ):
            places = 6 * steps[:, None] + np.arange(6)
            np.add.at(normal, (places[:, :, None], places[:, None, :]), blocks)
            np.add.at(right, places, rights[..., 0])

        own_inverse = np.linalg.inv(self._by_landmark(by_point_T @ seen.by_point))
        own_right = self._by_landmark(by_point_T @ r)[..., 0]
        point_anchor = self._by_landmark(by_point_T @ seen.by_anchor)
        point_pose, anchor_pose = by_point_T @ seen.by_pose, by_anchor_T @ seen.by_pose
        couplings = []
        for j, (first, end, a) in enumerate(
            zip(self._first, self._ends, self.anchor_of, strict=True)
        ):
            # From the anchor to the last pose that sees the landmark.
            after = self.step_of[first + 1 : end] - a
            anchor, window = slice(6 * a, 6 * a + 6), slice(6 * a, 6 * (a + after[-1] + 1))
            across = _side_by_side(anchor_pose[first + 1 : end], after)
            normal[anchor, window] += across
            normal[window, anchor] += across.T
            coupling = _side_by_side(point_pose[first + 1 : end], after)
            coupling[:, :6] = point_anchor[j]
            gain = coupling.T @ own_inverse[j]
            normal[window, window] -= gain @ coupling
            right[window] -= gain @ own_right[j]
            couplings.append((window, coupling))

        delta = np.zeros(size)
        delta[6:] = scipy.linalg.solve(normal[6:, 6:], right[6:], assume_a="pos")
        points = [
            inverse @ (own - coupling @ delta[window])
            for inverse, own, (window, coupling) in zip(
                own_inverse, own_right, couplings, strict=True
            )
        ]
        return np.concatenate([delta[6:], *points])

    def _add_twists(self, state: BatchState, normal: Array, right: Array) -> None:
        twists = self.twist_residuals(state)
        for residual, J, places in zip(
            twists.residual, twists.derivative, twists.places, strict=True
        ):
            J_T = np.swapaxes(J, 1, 2)
            np.add.at(normal, (places[:, :, None], places[:, None, :]), J_T @ J)
            np.add.at(right, places, (J_T @ residual[..., None])[..., 0])

    def _by_landmark(self, values: Array) -> Array:
        """Sums (M, ...) of what each observation (n, ...) adds to its landmark."""
        return np.add.reduceat(values, self._first, axis=0)

    def _motions(self, state: BatchState) -> Array:
        """Motions (n, 4, 4) from the pose that saw each landmark first to the one that sees it."""
        T = state.T_world_body
        return se3.inverse(T[self.anchor_of[self.landmark_of]]) @ T[self.step_of]


def optimise(
    problem: BatchProblem,
    start: BatchState,
    *,
    tolerance: float = 1e-5,
    max_iterations: int = 50,
) -> BatchResult:
    """Go downhill by Gauss and Newton until nothing moves.

    Parameters
    ----------
    problem : BatchProblem
    start : BatchState
    tolerance : float
        An iteration that moves every pose and the bias by less than this is the last, metres,
        radians and radians a second.
    max_iterations : int
    """
    state, costs, converged = start, [problem.cost(start)], False
    motion = 6 * (problem.steps - 1) + 3
    while not converged and len(costs) <= max_iterations:
        delta = problem.newton_step(state)
        converged = bool(np.max(np.abs(delta[:motion])) < tolerance)
        for halvings in range(_HALVINGS):
            moved = problem.moved(state, delta, 0.5**halvings)
            cost = problem.cost(moved)
            if cost < costs[-1] or converged:
                break
        else:
            break
        state = moved
        costs.append(cost)
    return BatchResult(state, tuple(costs), converged)


def _side_by_side(blocks: Array, places: NDArray[np.int64]) -> Array:
    """Blocks (n, r, 6) at increasing places (n,) of a row of such blocks, zeros elsewhere."""
    rows = blocks.shape[1]
    result = np.zeros((rows, int(places[-1]) + 1, 6))
    result[:, places] = np.swapaxes(blocks, 0, 1)
    return result.reshape(rows, -1)
