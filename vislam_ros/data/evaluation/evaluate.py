# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How good an estimate is: ATE, RPE and NEES against a reference trajectory.

ATE and RPE follow Sturm et al., *A Benchmark for the Evaluation of RGB-D SLAM Systems* (2012),
and equal what the commands ``evo_ape tum -a`` and ``evo_rpe tum`` print for the same files.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import Trajectory, read_tum
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Poses farther apart in time than this are not compared, seconds.
MAX_DIFFERENCE = 0.01

#: Length of the longer relative pose error, metres.
LONG_DELTA = 100.0

# A covariance whose correlation matrix has a smaller eigenvalue than this has no inverse.
_SINGULAR = 1e-12


def associate(
    reference: Trajectory, estimate: Trajectory, max_difference: float = MAX_DIFFERENCE
) -> tuple[Indices, Indices]:
    """Match each pose of the shorter trajectory to the pose of the longer one nearest in time.

    As :func:`associate_stamps` does with their stamps.
    """
    return associate_stamps(reference.stamps, estimate.stamps, max_difference)


def associate_stamps(
    reference: Indices, estimate: Indices, max_difference: float = MAX_DIFFERENCE
) -> tuple[Indices, Indices]:
    """Match each stamp of the fewer ones to that of the others nearest in time.

    Parameters
    ----------
    reference, estimate : ndarray of int64, (N,) and (M,)
        Nanoseconds, strictly increasing.
    max_difference : float
        Largest distance in time, seconds.

    Returns
    -------
    tuple of ndarray, (n,) each
        Rows of the reference and of the estimate that belong together.

    Raises
    ------
    VislamError
        Where fewer than two match.
    """
    if len(estimate) > len(reference):
        short, long = reference, estimate
    else:
        short, long = estimate, reference
    after = np.minimum(np.searchsorted(long, short, side="right"), len(long) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(long[after] - short) < np.abs(short - long[before]), after, before)
    rows = np.flatnonzero(np.abs(long[nearest] - short) <= round(max_difference * 1e9))
    if len(rows) < 2:
        raise VislamError(
            f"{len(rows)} poses of the reference lie within {max_difference} s of the estimate's: "
            "is it the reference of this drive, with the same clock?"
        )
    if len(estimate) > len(reference):
        return rows, nearest[rows]
    return nearest[rows], rows


def alignment(source: Array, target: Array) -> Array:
    """Rigid motion that brings points nearest to their targets in the least-squares sense.

    Umeyama, *Least-squares estimation of transformation parameters between two point patterns*
    (1991), eq. 40 and 41, without scale.

    Parameters
    ----------
    source, target : ndarray, (n, 3)

    Returns
    -------
    ndarray, (4, 4)
        ``T`` with ``T source`` nearest to ``target``. About the line of points that all lie on
        one, its angle is arbitrary.
    """
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    R = se3.nearest_rotation((target - target_mean).T @ (source - source_mean))
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = target_mean - R @ source_mean
    return T


def first_pose_alignment(reference: Trajectory, estimate: Trajectory) -> Array:
    """Motion (4, 4) that lays the reference's first pose in common onto the estimate's."""
    i, j = associate(reference, estimate)
    T_reference, T_estimate = reference.T_world_body[i[0]], estimate.T_world_body[j[0]]
    return T_estimate @ se3.inverse(T_reference)


def frame_pairs(poses: int, delta: int = 1) -> Indices:
    """Rows (n, 2) of poses that are ``delta`` frames apart, each pair beginning at the last."""
    rows = np.arange(0, poses, delta)
    return np.stack([rows[:-1], rows[1:]], axis=1)


def distance_pairs(positions: Array, delta: float) -> Indices:
    """Rows (n, 2) of poses with at least ``delta`` metres of path between them.

    Each pair begins where the one before ended.
    """
    ends, path = [0], 0.0
    for row, length in enumerate(np.linalg.norm(np.diff(positions, axis=0), axis=1), start=1):
        path += float(length)
        if path >= delta:
            ends.append(row)
            path = 0.0
    return np.stack([ends[:-1], ends[1:]], axis=1).astype(np.int64)


def relative_errors(T_reference: Array, T_estimate: Array, pairs: Indices) -> tuple[Array, Array]:
    """Error of the motion between the two poses of each pair.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)
    pairs : ndarray, (m, 2)

    Returns
    -------
    tuple of ndarray, (m,) each
        Length of the translation part, metres, and angle, radians.
    """
    i, j = pairs.T
    E = se3.inverse(se3.inverse(T_reference[i]) @ T_reference[j]) @ (
        se3.inverse(T_estimate[i]) @ T_estimate[j]
    )
    angles = np.linalg.norm(se3.log_rotation(E[:, :3, :3]), axis=1)
    return np.linalg.norm(E[:, :3, 3], axis=1), angles


def normalised_errors(T_reference: Array, T_estimate: Array, covariances: Array) -> Array:
    """Normalised estimation error squared of each pose: ``xi^T Sigma^-1 xi / 6``.

    ``xi = Log(T_hat^-1 T)`` with both trajectories moved so that their first pose is the
    identity. A filter that knows its own error has a mean of 1.

    Parameters
    ----------
    T_reference, T_estimate : ndarray, (n, 4, 4)
    covariances : ndarray, (n, 6, 6)
        Of ``xi``, in the body frame.

    Returns
    -------
    ndarray, (n,)
        NaN where the covariance is singular or not known.
    """
    T_reference = se3.inverse(T_reference[0]) @ T_reference
    T_estimate = se3.inverse(T_estimate[0]) @ T_estimate
    xi = se3.log(se3.inverse(T_estimate) @ T_reference)
    result = np.full(len(xi), np.nan)
    # The correlation matrix, free of units, tells whether the covariance has an inverse.
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    rows = np.flatnonzero(np.isfinite(covariances).all(axis=(1, 2)) & (variances > 0).all(axis=1))
    std = np.sqrt(variances[rows])
    correlations = covariances[rows] / (std[:, :, None] * std[:, None, :])
    regular = np.linalg.eigvalsh(correlations)[:, 0] > _SINGULAR
    rows, correlations = rows[regular], correlations[regular]
    scaled = (xi[rows] / std[regular])[:, :, None]
    result[rows] = np.sum(scaled * np.linalg.solve(correlations, scaled), axis=(1, 2)) / 6
    return result


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
    reference: Trajectory, estimate: Trajectory, covariances: Array | None = None
) -> dict[str, Any]:
    """All figures of one trajectory against a reference.

    Parameters
    ----------
    reference, estimate : Trajectory
    covariances : ndarray, (N, 6, 6), optional
        Of the estimate's poses, in the body frame.

    Returns
    -------
    dict
        ``poses`` compared; statistics of ``ate_m`` after alignment, of ``rpe_frame_m`` and
        ``rpe_frame_deg`` from frame to frame, of ``rpe_100m_m`` and ``rpe_100m_deg`` over each
        100 m of path (None where the drive is shorter); with covariances, the mean
        ``nees_per_dof`` of ``nees_poses`` poses, ``nees_left_out`` others having a singular or
        unknown covariance.
    """
    i, j = associate(reference, estimate)
    T_reference, T_estimate = reference.T_world_body[i], estimate.T_world_body[j]
    target, source = reference.positions[i], estimate.positions[j]
    T = alignment(source, target)
    residual = source @ T[:3, :3].T + T[:3, 3] - target
    result: dict[str, Any] = {
        "poses": len(i),
        "ate_m": statistics(np.linalg.norm(residual, axis=1)),
    }
    for name, pairs in (
        ("frame", frame_pairs(len(i))),
        (f"{LONG_DELTA:.0f}m", distance_pairs(source, LONG_DELTA)),
    ):
        metres, radians = relative_errors(T_reference, T_estimate, pairs)
        result[f"rpe_{name}_m"] = statistics(metres) if len(pairs) else None
        result[f"rpe_{name}_deg"] = statistics(np.rad2deg(radians)) if len(pairs) else None
    if covariances is not None:
        nees = normalised_errors(T_reference, T_estimate, covariances[j])
        nees = nees[np.isfinite(nees)]
        result["nees_per_dof"] = float(np.mean(nees)) if len(nees) else None
        result["nees_poses"] = len(nees)
        result["nees_left_out"] = len(i) - len(nees)
    return result


def path_length(trajectory: Trajectory) -> float:
    """Length of the path through all positions, metres."""
    return float(np.sum(np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1)))


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
        Mean normalised estimation error squared of a pose by its 6 degrees of freedom; None where
        the estimate has no covariances.
    """

    poses: int
    ate: Statistics
    rpe_frame: Statistics | None
    rpe_frame_deg: Statistics | None
    rpe_100m: Statistics | None
    rpe_100m_deg: Statistics | None
    nees_per_dof: float | None


def evaluate(estimate: Trajectory | Path | str, reference: Trajectory | Path | str) -> Evaluation:
    """Compare an estimate with a reference: ATE, RPE and NEES.

    Parameters
    ----------
    estimate, reference : Trajectory, Path or str
        A path is that of a TUM file.

    Raises
    ------
    VislamError
        Where a file cannot be read, or the two have fewer than two stamps in common.
    """
    estimate, reference = (
        each if isinstance(each, Trajectory) else read_tum(each) for each in (estimate, reference)
    )
    figures = compare(reference, estimate, estimate.covariances)

    def statistics_of(name: str) -> Statistics | None:
        return Statistics(**figures[name]) if figures[name] else None

    return Evaluation(
        poses=figures["poses"],
        ate=Statistics(**figures["ate_m"]),
        rpe_frame=statistics_of("rpe_frame_m"),
        rpe_frame_deg=statistics_of("rpe_frame_deg"),
        rpe_100m=statistics_of("rpe_100m_m"),
        rpe_100m_deg=statistics_of("rpe_100m_deg"),
        nees_per_dof=figures.get("nees_per_dof"),
    )


def evaluate_results(directory: Path, reference: Path) -> dict[str, Any]:
    """Compare what a result directory holds with a reference file.

    Parameters
    ----------
    directory : Path
        Of results.
    reference : Path
        TUM file.

    Returns
    -------
    dict
        ``reference``, ``reference_length_m``, and under ``trajectory``, ``dead_reckoning`` and
        ``smoothed``, where there are such, the figures of :func:`compare`.

    Raises
    ------
    VislamError
        Where a file is missing or damaged, or the two do not belong together.
    """
    results, truth = read_results(directory), read_tum(reference)
    evaluation: dict[str, Any] = {
        "reference": str(reference),
        "reference_length_m": path_length(truth),
    }
    try:
        evaluation["trajectory"] = compare(truth, results.trajectory, results.covariances)
        if results.dead_reckoning is not None:
            evaluation["dead_reckoning"] = compare(truth, results.dead_reckoning)
        if results.smoothed is not None:
            evaluation["smoothed"] = compare(truth, results.smoothed, results.smoothed_covariances)
    except VislamError as error:
        raise VislamError(f"{reference}: {error}") from error
    return evaluation
