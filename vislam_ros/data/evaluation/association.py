# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which pose of an estimate belongs to which pose of its reference: the nearest in time."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError

Indices = NDArray[np.int64]

#: Poses farther apart in time than this are not compared, seconds; evo's default, too.
MAX_DIFFERENCE = 0.01


def read_reference(path: Path, results: Results) -> Trajectory:
    """Read the reference of a run, and see that it is one of each of its trajectories.

    Raises
    ------
    VislamError
        Naming both, where fewer than two poses belong together; where the file cannot be read.
    """
    reference = read_trajectory(path)
    with named_pair(results.directory, path):
        for estimate in (results.trajectory, results.dead_reckoning, results.smoothed):
            if estimate is not None:
                associate(reference, estimate)
    return reference


@contextmanager
def named_pair(run: Path, reference: Path) -> Iterator[None]:
    """Name in every VislamError what is held against what."""
    try:
        yield
    except VislamError as error:
        raise VislamError(f"{run} against {reference}: {error}") from error


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
    for name, stamps in (("reference", reference), ("estimate", estimate)):
        if not len(stamps):
            raise VislamError(f"the {name} has no pose: there is nothing to compare")
    if len(estimate) > len(reference):
        short, long = reference, estimate
    else:
        short, long = estimate, reference
    after = np.minimum(np.searchsorted(long, short, side="right"), len(long) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(long[after] - short) < np.abs(short - long[before]), after, before)
    rows = np.flatnonzero(np.abs(long[nearest] - short) <= round(max_difference * NANOSECONDS))
    if len(rows) < 2:
        raise VislamError(
            f"{len(rows)} poses of the reference lie within {max_difference:g} s of the "
            f"estimate's: it has {_span(reference)}, the estimate {_span(estimate)}: is it the "
            "reference of this drive, with the same clock?"
        )
    if len(estimate) > len(reference):
        return rows, nearest[rows]
    return nearest[rows], rows


def _span(stamps: Indices) -> str:
    first, last = stamps[0] / NANOSECONDS, stamps[-1] / NANOSECONDS
    return f"{len(stamps)} from {first:.2f} to {last:.2f} s"
