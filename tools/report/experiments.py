# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments of the report: what settings each has, and what they give on a drive.

All are the report's Table I with one thing changed. Where the report gives no number (how much a
large V or a large prior is), a hundredfold either way is taken.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from vislam_ros.core.filters.flat_settings import replaced
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.solving import solve
from vislam_ros.data.sweeps.worker_pool import in_processes
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

TABLE_I, RECOMMENDED = "table_i", "recommended"

_LARGER, _SMALLER = 100.0, 0.01
_LARGE_PRIOR = {"landmark_prior_variance": 0.5 * _LARGER, "prior_pose_variance": 0.01 * _LARGER}
_SMALL_PRIOR = {"landmark_prior_variance": 0.5 * _SMALLER, "prior_pose_variance": 0.01 * _SMALLER}


@dataclass(frozen=True)
class Experiment:
    """One run of the report's filter.

    Attributes
    ----------
    title : str
        What is particular about it.
    changes : mapping
        Settings of the SLAM filter that differ from the base.
    base : str
        Whose settings the others are: Table I's or the recommended ones.
    """

    title: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    base: str = TABLE_I


def _fraction(share: float, **changes: Any) -> dict[str, Any]:
    return {"feature_fraction": share, **changes}


def _noise(variance: float) -> dict[str, Any]:
    return _fraction(0.33, pixel_variance=(variance,) * 4)


#: By name; figures refer to these.
EXPERIMENTS = {
    "table_i_33": Experiment("V = 100 I and W = 1e-10 I, as in Table I", _fraction(0.33)),
    "v_0.01": Experiment("V = 0.01 I", _noise(0.01)),
    "v_1": Experiment("V = 1 I", _noise(1.0)),
    "v_10000": Experiment("V = 10 000 I", _noise(10_000.0)),
    "w_1e-9": Experiment("W = 1e-9 I", _fraction(0.33, process_variance=1e-9)),
    "w_1e-8": Experiment("W = 1e-8 I", _fraction(0.33, process_variance=1e-8)),
    "table_i_50": Experiment("prior of Table I: 0.5 I and 0.01 I", _fraction(0.5)),
    "large_prior_50": Experiment(
        "landmarks 50 I, pose 1 I: each a hundred times that of Table I",
        _fraction(0.5, **_LARGE_PRIOR),
    ),
    "small_prior_50": Experiment(
        "landmarks 0.005 I, pose 0.0001 I: each a hundredth of that of Table I",
        _fraction(0.5, **_SMALL_PRIOR),
    ),
    "recommended": Experiment("config/ekf.yaml", base=RECOMMENDED),
}


@dataclass(frozen=True)
class ExperimentResult:
    """What an experiment gave.

    Attributes
    ----------
    trajectory, dead_reckoning : Trajectory
    landmarks : ndarray, (M, 3)
        Positions in the map, metres.
    """

    trajectory: Trajectory
    dead_reckoning: Trajectory
    landmarks: Array

    def figures(self, reference: Trajectory | None) -> dict[str, float | int | None]:
        """Return the numbers in which experiments differ, in metres.

        ``from_dead_reckoning_m`` is the RMS distance of the two paths as they stand, from the
        same origin; ``landmark_distance_m`` that of a landmark to the nearest pose, the median,
        and ``landmark_distance_90_m`` the greatest of the nearest 90 %.
        """
        positions = self.trajectory.positions
        finite = np.isfinite(positions).all(axis=1)
        landmarks = self.landmarks[np.isfinite(self.landmarks).all(axis=1)]
        result: dict[str, float | int | None] = {
            "poses": len(positions),
            "finite_poses": int(finite.sum()),
            "landmarks": len(self.landmarks),
            "ate_m": None,
            "from_dead_reckoning_m": None,
            "landmark_distance_m": None,
            "landmark_distance_90_m": None,
        }
        if not finite.all():
            return result
        if reference is not None:
            result["ate_m"] = compare(reference, self.trajectory)["ate_m"]["rmse"]
        prediction = self.dead_reckoning
        rows = np.minimum(
            np.searchsorted(prediction.stamps, self.trajectory.stamps), len(prediction) - 1
        )
        apart = positions - prediction.positions[rows]
        result["from_dead_reckoning_m"] = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
        if len(landmarks):
            distances = KDTree(positions).query(landmarks)[0]
            result["landmark_distance_m"] = float(np.median(distances))
            result["landmark_distance_90_m"] = float(np.percentile(distances, 90))
        return result


@dataclass(frozen=True)
class BaseSettings:
    """The settings of Table I and the recommended ones."""

    slam: Mapping[str, SlamSettings]
    prediction: Mapping[str, PredictionSettings]


def run_experiments(
    drive: Drive,
    base: BaseSettings,
    names: tuple[str, ...],
    jobs: int,
    on_result: Callable[[str], None] | None = None,
) -> dict[str, ExperimentResult]:
    """Run experiments, so many at a time; call back with the name of each that has ended.

    Raises
    ------
    VislamError
        Naming the experiment that failed.
    """
    results: dict[str, ExperimentResult] = {}
    for index, outcome in in_processes(run_experiment, (drive, base), names, jobs):
        if isinstance(outcome, Exception):
            raise VislamError(f"{names[index]}: {outcome}") from outcome
        results[names[index]] = outcome
        if on_result:
            on_result(names[index])
    return results


def run_experiment(given: tuple[Drive, BaseSettings], name: str) -> ExperimentResult:
    """Run one experiment."""
    drive, base = given
    experiment = EXPERIMENTS[name]
    settings = replaced(base.slam[experiment.base], **dict(experiment.changes))
    solution = solve(drive, settings, base.prediction[experiment.base])
    return ExperimentResult(
        solution.trajectory, solution.dead_reckoning, solution.landmarks.positions
    )
