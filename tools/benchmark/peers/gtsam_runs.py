# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""GTSAM's estimators on the tracks of our filter: iSAM2, a fixed-lag smoother, the batch optimum.

What each knows: the pixels of our tracks as stereo factors (with Huber's loss, as they have no
gate), the twists as factors between poses, and the noise of both. No ready-made factor ties poses
to the bias of a gyroscope, so it can be given to them, which costs them nothing.
"""

import dataclasses
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.interleaving import cpu_clock
from benchmark.peers.gtsam_factors import GraphGrowth, GtsamFactors, Recipe
from benchmark.peers.problem import PeerProblem
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_Update = Callable[[int, Any, Any, list[int]], object]


class PeerFailure(VislamError):
    """A peer gave up."""


@dataclass(frozen=True)
class PeerRun:
    """What a peer did.

    Attributes
    ----------
    online : ndarray, (T, 4, 4), or None
        Each pose as it stood right after its step, as a filter gives it.
    final : ndarray, (T, 4, 4), or None
        All poses as they stand at the end, as a smoother gives them.
    update_seconds : ndarray, (T,)
        Processor time in GTSAM itself, of each step; of a batch, one number for all.
    build_seconds : float
        Time in which Python made the factors, all steps together.
    landmarks, observations : int
        In the graph.
    iterations : int or None
        Of a batch.
    cost : float or None
        Of a batch, at its end.
    """

    online: Array | None
    final: Array | None
    update_seconds: Array
    build_seconds: float
    landmarks: int
    observations: int
    iterations: int | None = None
    cost: float | None = None


def gtsam_is_installed() -> bool:
    """Whether GTSAM can be had."""
    return importlib.util.find_spec("gtsam") is not None


def run_isam2(
    problem: PeerProblem,
    recipe: Recipe,
    gyro_bias: Array | None = None,
    *,
    covariance: bool = False,
    careful: bool = False,
) -> PeerRun:
    """Run iSAM2, by default with its parameters as GTSAM sets them.

    These relinearise, each tenth step, what has moved by 0.1 (metres, radians).

    Parameters
    ----------
    problem : PeerProblem
    recipe : Recipe
    gyro_bias : ndarray, (3,), optional
        To be taken from the twists, rad/s.
    covariance : bool
        Whether each step asks for the covariance of its pose, too, which our filter always has.
    careful : bool
        Whether it relinearises, at each step, what has moved by 0.01.

    Raises
    ------
    PeerFailure
        Where it gives up, with its reason.
    """
    factors = GtsamFactors(problem)
    parameters = factors.gtsam.ISAM2Params()
    if careful:
        parameters.relinearizeSkip = 1
        parameters.setRelinearizeThreshold(0.01)
    smoother = factors.gtsam.ISAM2(parameters)
    growth = GraphGrowth(factors, recipe, gyro_bias, memory=problem.steps)

    def update(_: int, graph: Any, values: Any, __: list[int]) -> object:
        return smoother.update(graph, values)

    def pose_of(key: int) -> Any:
        if covariance:
            smoother.marginalCovariance(key)
        return smoother.calculateEstimatePose3(key)

    run = _run_online(growth, update, pose_of)
    return dataclasses.replace(run, final=factors.poses(smoother.calculateEstimate()))


def run_fixed_lag(
    problem: PeerProblem, recipe: Recipe, gyro_bias: Array | None = None, *, lag: float = 2.0
) -> PeerRun:
    """Run the incremental fixed-lag smoother over a window of ``lag`` seconds, else as above.

    Raises
    ------
    PeerFailure
        Where it gives up, with its reason.
    """
    factors = GtsamFactors(problem)
    parameters = factors.gtsam.ISAM2Params()
    # Of the places of factors that have left the window; else they grow without end.
    parameters.findUnusedFactorSlots = True
    smoother = factors.gtsam.IncrementalFixedLagSmoother(lag, parameters)
    times = np.cumsum(problem.durations)
    memory = int(lag / np.median(problem.durations[1:]))
    growth = GraphGrowth(factors, recipe, gyro_bias, memory=memory)

    def update(k: int, graph: Any, values: Any, touched: list[int]) -> object:
        return smoother.update(graph, values, dict.fromkeys(touched, float(times[k])))

    return _run_online(growth, update, smoother.calculateEstimatePose3)


def _run_online(growth: GraphGrowth, update: _Update, pose_of: Callable[[int], Any]) -> PeerRun:
    """Grow the graph step by step; the poses are taken as they come."""
    factors = growth.factors
    T = np.eye(4)
    online, seconds, build_seconds = [], [], 0.0
    for k in range(factors.problem.steps):
        begin = cpu_clock()
        graph, values, touched = growth.step(k, T)
        built = cpu_clock()
        try:
            update(k, graph, values, touched)
            T = pose_of(factors.pose_key(k)).matrix()
        except RuntimeError as error:
            reason = " ".join(str(error).split())
            raise PeerFailure(f"gave up at step {k}: {reason[:200]}") from error
        seconds.append(cpu_clock() - built)
        build_seconds += built - begin
        online.append(T)
    return PeerRun(
        online=np.array(online),
        final=None,
        update_seconds=np.array(seconds),
        build_seconds=build_seconds,
        landmarks=growth.landmarks,
        observations=growth.observations,
    )


def run_batch(
    problem: PeerProblem, recipe: Recipe, initial: Array, gyro_bias: Array | None = None
) -> PeerRun:
    """Find the batch optimum by Levenberg-Marquardt.

    Parameters
    ----------
    problem : PeerProblem
    recipe : Recipe
    initial : ndarray, (T, 4, 4)
        Poses to begin with.
    gyro_bias : ndarray, (3,), optional
        To be taken from the twists, rad/s.

    Raises
    ------
    PeerFailure
        Where it gives up, with its reason.
    """
    factors = GtsamFactors(problem)
    begin = cpu_clock()
    batch = factors.whole_graph(recipe, initial, gyro_bias)
    built = cpu_clock()
    try:
        parameters = factors.gtsam.LevenbergMarquardtParams()
        # A drive drifts by a metre at the price of some 1e-4 of the cost.
        parameters.setRelativeErrorTol(1e-7)
        optimizer = factors.gtsam.LevenbergMarquardtOptimizer(
            batch.graph, batch.values, parameters
        )
        values = optimizer.optimize()
    except RuntimeError as error:
        raise PeerFailure(" ".join(str(error).split())[:200]) from error
    return PeerRun(
        online=None,
        final=factors.poses(values),
        update_seconds=np.array([cpu_clock() - built]),
        build_seconds=built - begin,
        landmarks=batch.landmarks,
        observations=batch.observations,
        iterations=int(optimizer.iterations()),
        cost=float(optimizer.error()),
    )
