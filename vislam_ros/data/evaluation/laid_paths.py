# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paths of a result in one frame, and the errors of exactly these: what a picture shows."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.alignment import (
    AlignmentKind,
    align_positions,
    first_pose_alignment,
)
from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.evaluation.evaluate import WHOLE, length_words
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory, path_length

Array = NDArray[np.float64]

Laying: TypeAlias = AlignmentKind | Literal["first"]
"""How a path is laid onto its reference: as for the ATE, or first pose onto first pose."""

LAYINGS: tuple[Laying, ...] = (*get_args(AlignmentKind), "first")

_WORDS: dict[Laying, str] = {
    "se3": "each laid onto the reference (SE(3))",
    "yaw": "each laid onto the reference (yaw and position)",
    "none": "in the reference's own frame",
    "first": "first pose laid onto the reference's",
}


@dataclass(frozen=True)
class LaidPath:
    """A path where a picture has it.

    Attributes
    ----------
    name : str
        ``estimate``, ``smoothed``, ``dead reckoning`` or ``reference``.
    stamps : ndarray of int64, (n,)
        Nanoseconds.
    positions : ndarray, (n, 3)
        In the map frame, metres.
    rmse : float or None
        Root mean square of its distances from the reference as both lie here, metres; None where
        there is no reference, and for the reference itself.
    """

    name: str
    stamps: NDArray[np.int64]
    positions: Array
    rmse: float | None = None


@dataclass(frozen=True)
class LaidPaths:
    """All paths of a result in the map frame.

    Attributes
    ----------
    paths : tuple of LaidPath
        The estimate first; the reference last, where there is one.
    laying : str
        How they were laid, in words; empty without a reference.
    ambiguity : str or None
        Why the estimate could be laid otherwise as well, where it can.
    """

    paths: tuple[LaidPath, ...]
    laying: str = ""
    ambiguity: str | None = None

    def get(self, name: str) -> LaidPath | None:
        """Return the path of a name, where there is one."""
        return next((path for path in self.paths if path.name == name), None)


def laid_paths(
    results: Results, reference: Trajectory | None = None, laying: Laying = "se3"
) -> LaidPaths:
    """Bring all paths of a result, and a reference, into its map frame.

    The estimate stays where it is, and so does its map; the reference is carried to it, from the
    first pose that is compared to the last. Each other
    path is laid onto the reference by itself, so that the distance between what is drawn is the
    error that is told. With ``none`` nothing moves.

    Parameters
    ----------
    results : Results
    reference : Trajectory, optional
    laying : str
        One of :data:`LAYINGS`.

    Raises
    ------
    VislamError
        Where the reference has fewer than two stamps in common with the estimate, or ``laying``
        is unknown.
    """
    own = [("estimate", results.trajectory)]
    if results.smoothed is not None:
        own.append(("smoothed", results.smoothed))
    # Where a gyroscope alone measures the motion, it stays where it was, and is no path.
    if results.dead_reckoning is not None and results.dead_reckoning.positions.any():
        own.append(("dead reckoning", results.dead_reckoning))
    if reference is None:
        return LaidPaths(tuple(LaidPath(name, t.stamps, t.positions) for name, t in own))
    paths = []
    compared = np.empty(0, dtype=np.int64)
    T_map_reference = np.eye(4)
    ambiguity = None
    for name, trajectory in own:
        i, j = associate(reference, trajectory)
        compared = np.union1d(compared, i)
        source, target = trajectory.positions[j], reference.positions[i]
        if laying == "first":
            T_reference_path = se3.inverse(first_pose_alignment(reference, trajectory))
            residual = _moved(T_reference_path, source) - target
        else:
            aligned = align_positions(source, target, laying)
            T_reference_path, residual = aligned.T_reference_estimate, aligned.residual
        if name == "estimate":
            T_map_reference = se3.inverse(T_reference_path)
            ambiguity = None if laying == "first" else aligned.ambiguity
        positions = trajectory.positions
        if name != "estimate":
            positions = _moved(T_map_reference @ T_reference_path, positions)
        rmse = float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))
        paths.append(LaidPath(name, trajectory.stamps, positions, rmse))
    part, words = reference.between(compared), _WORDS[laying]
    truth = _moved(T_map_reference, part.positions)
    paths.append(LaidPath("reference", part.stamps, truth))
    whole, length = path_length(reference), path_length(part)
    if length < WHOLE * whole:
        words += f"; {length_words(length)} of its {length_words(whole)}"
    return LaidPaths(tuple(paths), words, ambiguity)


def _moved(T: Array, positions: Array) -> Array:
    return positions @ T[:3, :3].T + T[:3, 3]
