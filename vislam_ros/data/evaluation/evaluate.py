# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How good an estimate is: ATE, RPE and NEES against a reference trajectory.

ATE and RPE follow Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems* (2012),
and equal what the commands ``evo_ape tum -a`` and ``evo_rpe tum`` print for the same files. Errors
over stretches of the path are KITTI's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.evaluation.alignment import AlignmentKind, align_positions, best_scale
from vislam_ros.data.evaluation.association import MAX_DIFFERENCE, associate, named_pair
from vislam_ros.data.evaluation.consistency import consistency_figures, normalised_errors
from vislam_ros.data.evaluation.relative import (
    distance_pairs,
    frame_pairs,
    relative_errors,
    stretch_errors,
)
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import Trajectory, path_length
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import of_type

Array = NDArray[np.float64]

#: From this share on, what is compared of a reference is all of it.
WHOLE = 0.99
#: Length of the longer relative pose error, metres.
LONG_DELTA = 100.0


def statistics(errors: Array) -> dict[str, float]:
    """RMSE, mean, median, standard deviation, least and greatest of errors (n,)."""
    return {
        "rmse": float(np.sqrt(np.mean(errors**2))),
        "mean": float(np.mean(errors)),
        "median": float(np.median(errors)),
        "std": float(np.std(errors)),
        "min": float(np.min(errors)),
        "max": float(np.max(errors)),
    }


def compare(
    reference: Trajectory,
    estimate: Trajectory,
    covariances: Array | None = None,
    *,
    align: AlignmentKind = "se3",
    max_difference: float = MAX_DIFFERENCE,
) -> dict[str, Any]:
    """All figures of one trajectory against a reference.

    Parameters
    ----------
    reference, estimate : Trajectory
    covariances : ndarray, (N, 6, 6), optional
        Of the estimate's poses, in the body frame.
    align : str
        What the alignment before the ATE may do: ``se3``, ``yaw`` (with a shift) or ``none``.
    max_difference : float
        Largest distance in time of two poses that are compared, seconds.

    Returns
    -------
    dict
        ``poses`` compared; ``compared_m``, the reference's path from the first of them to the
        last; ``alignment`` and ``alignment_ambiguity``, why another one fits as well
        or None; ``scale``, the factor by which the aligned path fits best, which is not applied
        (None where all its poses are at one place); statistics of ``ate_m`` after alignment, of
        ``rpe_frame_m`` and ``rpe_frame_deg`` from frame to frame, of ``rpe_100m_m`` and
        ``rpe_100m_deg`` over each 100 m of path (None where the drive is shorter); ``kitti``, the
        means over all stretches of the path (None where there is none), and ``kitti_by_length``,
        those of each length (see :func:`~vislam_ros.data.evaluation.relative.stretch_errors`);
        with covariances, what
        :func:`~vislam_ros.data.evaluation.consistency.consistency_figures` says, and
        ``covariances_missing``, of how many poses there is none.

    Raises
    ------
    VislamError
        Where fewer than two poses belong together.
    """
    i, j = associate(reference, estimate, max_difference)
    T_reference, T_estimate = reference.T_world_body[i], estimate.T_world_body[j]
    source = estimate.positions[j]
    aligned = align_positions(source, reference.positions[i], align)
    result: dict[str, Any] = {
        "poses": len(i),
        "compared_m": path_length(reference.between(i)),
        "alignment": align,
        "alignment_ambiguity": aligned.ambiguity,
        "scale": best_scale(source, reference.positions[i]),
        "ate_m": statistics(np.linalg.norm(aligned.residual, axis=1)),
    }
    for name, pairs in (
        ("frame", frame_pairs(len(i))),
        (f"{LONG_DELTA:.0f}m", distance_pairs(source, LONG_DELTA)),
    ):
        metres, radians = relative_errors(T_reference, T_estimate, pairs)
        result[f"rpe_{name}_m"] = statistics(metres) if len(pairs) else None
        result[f"rpe_{name}_deg"] = statistics(np.rad2deg(radians)) if len(pairs) else None
    stretches = stretch_errors(T_reference, T_estimate)
    result["kitti"] = stretches.figures()
    result["kitti_by_length"] = stretches.by_length()
    if covariances is not None:
        nees = normalised_errors(T_reference, T_estimate, covariances[j])
        result.update(consistency_figures(nees))
        unknown = np.isnan(covariances[j]).any(axis=(1, 2))
        result["covariances_missing"] = int(np.count_nonzero(unknown))
    return result


def length_words(metres: float) -> str:
    """Return a length in words, with three digits of it, to the millimetre at most."""
    decimals = 0 if metres >= 99.5 else 1 if metres >= 9.95 else 2 if metres >= 0.995 else 3
    return f"{metres:.{decimals}f} m"


@dataclass(frozen=True)
class Statistics:
    """What errors amount to: root mean square, mean, median, deviation, least and greatest."""

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float


@dataclass(frozen=True)
class Evaluation:
    """The figures of :func:`compare` as attributes.

    Attributes
    ----------
    poses : int
        How many were compared.
    ate : Statistics
        Distances from the reference after alignment, metres.
    rpe_frame, rpe_100m : Statistics or None
        Errors of the motion from frame to frame, and over each 100 m of path, metres; None where
        the drive is shorter.
    rpe_frame_deg, rpe_100m_deg : Statistics or None
        The same of the turn, degrees.
    nees_per_dof : float or None
        Mean normalised estimation error squared of a pose by its 6 degrees of kind; None where
        the estimate has no covariances.
    nees_bounds : tuple of float or None
        What holds 95 % of the poses of a filter that knows its error.
    nees_inside : float or None
        The share of the poses that lies within.
    kitti_percent, kitti_deg_per_100m : float or None
        Mean error over stretches of 50 to 400 m, % of their length and degrees a 100 m; None where
        the reference stands still.
    alignment_ambiguity : str or None
        Why another alignment would fit as well, where one does.
    scale : float or None
        By which factor the aligned path would fit best; it is not applied.
    """

    poses: int
    ate: Statistics
    rpe_frame: Statistics | None
    rpe_frame_deg: Statistics | None
    rpe_100m: Statistics | None
    rpe_100m_deg: Statistics | None
    nees_per_dof: float | None
    nees_bounds: tuple[float, float] | None = None
    nees_inside: float | None = None
    kitti_percent: float | None = None
    kitti_deg_per_100m: float | None = None
    alignment_ambiguity: str | None = None
    scale: float | None = None


def evaluate(
    estimate: Trajectory | Path | str,
    reference: Trajectory | Path | str,
    *,
    align: AlignmentKind = "se3",
    max_difference: float = MAX_DIFFERENCE,
) -> Evaluation:
    """Compare an estimate with a reference: ATE, RPE and NEES.

    Parameters
    ----------
    estimate, reference : Trajectory, Path or str
        A path is that of a TUM file, in seconds or nanoseconds, or of EuRoC's csv.
    align : str
        What the alignment before the ATE may do: ``se3``, ``yaw`` (with a shift) or ``none``.
    max_difference : float
        Largest distance in time of two poses that are compared, seconds.

    Raises
    ------
    VislamError
        Where a file cannot be read, the two have fewer than two stamps in common, or one is
        neither.
    """
    estimate, reference = _trajectory("estimate", estimate), _trajectory("reference", reference)
    figures = compare(
        reference,
        estimate,
        estimate.covariances,
        align=align,
        max_difference=max_difference,
    )

    def statistics_of(name: str) -> Statistics | None:
        return Statistics(**figures[name]) if figures[name] else None

    kitti = figures["kitti"] or {}
    bounds = figures.get("nees_bounds")
    return Evaluation(
        poses=figures["poses"],
        ate=Statistics(**figures["ate_m"]),
        rpe_frame=statistics_of("rpe_frame_m"),
        rpe_frame_deg=statistics_of("rpe_frame_deg"),
        rpe_100m=statistics_of("rpe_100m_m"),
        rpe_100m_deg=statistics_of("rpe_100m_deg"),
        nees_per_dof=figures.get("nees_per_dof"),
        nees_bounds=(bounds[0], bounds[1]) if bounds else None,
        nees_inside=figures.get("nees_inside"),
        kitti_percent=kitti.get("translation_percent"),
        kitti_deg_per_100m=kitti.get("rotation_deg_per_100m"),
        alignment_ambiguity=figures["alignment_ambiguity"],
        scale=figures["scale"],
    )


def _trajectory(what: str, given: Trajectory | Path | str) -> Trajectory:
    if isinstance(given, Trajectory):
        return given
    wanted = "a Trajectory, as a solution's trajectory or smoothed, or the path of its file"
    return read_trajectory(of_type(what, given, (str, Path), wanted))


def evaluate_results(
    directory: Path,
    reference: Path,
    *,
    align: AlignmentKind = "se3",
    max_difference: float = MAX_DIFFERENCE,
) -> dict[str, Any]:
    """Compare one of the runs of :func:`evaluate_runs` with a reference file."""
    (evaluation,) = evaluate_runs(
        [directory], reference, align=align, max_difference=max_difference
    )
    return evaluation


def evaluate_runs(
    runs: Sequence[Path],
    reference: Path,
    *,
    align: AlignmentKind = "se3",
    max_difference: float = MAX_DIFFERENCE,
) -> list[dict[str, Any]]:
    """Compare what runs have left with a reference file.

    Parameters
    ----------
    runs : sequence of Path
        Result directories, or trajectory files of whatever program.
    reference : Path
        TUM file, in seconds or nanoseconds, or EuRoC's csv.
    align, max_difference
        As in :func:`compare`.

    Returns
    -------
    list of dict
        Of each run ``run``, ``reference``, ``reference_length_m``, and under ``trajectory``,
        ``dead_reckoning`` and ``smoothed``, where there are such, the figures of :func:`compare`.

    Raises
    ------
    VislamError
        Where a file is missing or damaged, or the two do not belong together.
    """
    truth = read_trajectory(reference)
    evaluations = []
    for run, estimates in [(run, _estimates(run)) for run in runs]:
        evaluation: dict[str, Any] = {
            "run": str(run),
            "reference": str(reference),
            "reference_length_m": path_length(truth),
        }
        with named_pair(run, reference):
            for name, (estimate, covariances) in estimates.items():
                evaluation[name] = compare(
                    truth, estimate, covariances, align=align, max_difference=max_difference
                )
        evaluations.append(evaluation)
    return evaluations


def _estimates(run: Path) -> dict[str, tuple[Trajectory, Array | None]]:
    """Trajectories of a run by name, with their covariances."""
    if run.is_file():
        return {"trajectory": (read_trajectory(run), None)}
    results = read_results(run)
    estimates: dict[str, tuple[Trajectory, Array | None]] = {
        "trajectory": (results.trajectory, results.covariances)
    }
    if results.dead_reckoning is not None:
        estimates["dead_reckoning"] = (results.dead_reckoning, None)
    if results.smoothed is not None:
        estimates["smoothed"] = (results.smoothed, results.smoothed_covariances)
    return estimates
