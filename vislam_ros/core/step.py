# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A step's record, declared once.

The numbers of :class:`SlamStep` that are declared with a meaning are the columns of
``steps.csv``, of ``slam/steps`` and of whoever reads them; behind them stand the twist and what
the estimator tells of its own. A new column is a new field here, at the end of those there are.
"""

import dataclasses
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.columns import Column, Estimate
from vislam_ros.core.filters.quantities import ANGULAR_VELOCITY, VELOCITY

Array = NDArray[np.float64]

Row = Mapping[str, float]
"""Numbers of a step by column, in the order of the columns."""


class Meaning(NamedTuple):
    """Makes a field a column: what it means, and its unit where it has one."""

    text: str
    unit: str = ""


@dataclass(frozen=True)
class SlamStep:
    """The estimate after one features message, and what was done with it.

    Attributes
    ----------
    stamp : int
        And all other numbers down to ``left_out``: see their declarations.
    position, quaternion : ndarray, (3,), (4,)
        Body in the map, metres; x, y, z, w.
    covariance : ndarray, (6, 6)
        Of the pose error ``[rho; theta]`` on the right.
    twist : ndarray, (6,)
        ``[v; omega]`` in body axes over the step, metres and radians a second.
    twist_covariance : ndarray, (6, 6)
    T_map_odom : ndarray, (4, 4)
        Carries the predicted pose of the same stamp into the map.
    estimates : tuple of Estimate
        What the estimator tells besides.
    """

    stamp: Annotated[
        int, Meaning("stamp of the features message; in `steps.csv` in seconds", "ns")
    ]
    frozen: Annotated[bool, Meaning("whether the frame repeats the last one's pixels")]
    active: Annotated[int, Meaning("landmarks that the next frame can correct")]
    used: Annotated[int, Meaning("observations that corrected the state")]
    rejected: Annotated[int, Meaning("observations that failed a gate")]
    observed: Annotated[int, Meaning("observations in the frame")]
    admitted: Annotated[int, Meaning("observations that began a landmark")]
    landmarks: Annotated[int, Meaning("landmarks in the whole map")]
    nis: Annotated[float, Meaning("normalised innovation squared of those used together")]
    nis_dof: Annotated[int, Meaning("its degrees of freedom")]
    ms: Annotated[float, Meaning("time that the step took", "ms")]
    tracks: Annotated[int, Meaning("different ids so far")]
    first_of_pass: Annotated[bool, Meaning("whether the estimate began with this step")]
    left_out: Annotated[int, Meaning("new tracks that `max_active` had no room for")]
    position: Array
    quaternion: Array
    covariance: Array
    twist: Array
    twist_covariance: Array
    T_map_odom: Array
    estimates: tuple[Estimate, ...]

    def __repr__(self) -> str:
        place = ", ".join(f"{value:.2f}" for value in self.position)
        return (
            f"<SlamStep at {self.stamp * 1e-9:.3f} s: at ({place}) m, {self.used} of "
            f"{self.observed} observations used, {self.landmarks} landmarks>"
        )

    def row(self) -> dict[str, float]:
        """All numbers of the step by column, as ``steps.csv`` has them."""
        row: dict[str, float] = {column.name: getattr(self, column.name) for column in COLUMNS}
        std = np.sqrt(np.maximum(self.twist_covariance.diagonal(), 0.0))
        row.update(Estimate(VELOCITY, self.twist[:3], std[:3]).numbers())
        row.update(Estimate(ANGULAR_VELOCITY, self.twist[3:], std[3:]).numbers())
        for estimate in self.estimates:
            row.update(estimate.numbers())
        return row


COLUMNS = tuple(
    Column(each.name, kind, meaning.unit, meaning.text)
    for each in dataclasses.fields(SlamStep)
    if get_origin(each.type) is Annotated
    for kind, meaning in [get_args(each.type)]
)
"""Columns that every step has whatever its estimator is, in order."""

KINDS: Mapping[str, type] = {column.name: column.kind for column in COLUMNS}
"""Types of these columns by name; all others hold floats."""


def estimates_of(row: Row) -> dict[str, float]:
    """What a row holds besides these: the twist, and the estimator's own quantities."""
    return {name: value for name, value in row.items() if name not in KINDS}


@dataclass
class StepTotals:
    """What many steps amount to."""

    steps: int = 0
    frozen_steps: int = 0
    observations: int = 0
    used: int = 0
    rejected: int = 0
    nis: float = 0.0
    nis_dof: int = 0
    left_out: int = 0
    ms: "array[float]" = field(default_factory=lambda: array("d"))

    @classmethod
    def of_table(cls, table: Mapping[str, NDArray[Any]]) -> "StepTotals":
        """Totals of the columns of ``steps.csv``."""
        return cls(
            steps=len(table["stamp"]),
            frozen_steps=int(np.sum(table["frozen"])),
            observations=int(np.sum(table["observed"])),
            used=int(np.sum(table["used"])),
            rejected=int(np.sum(table["rejected"])),
            nis=float(np.sum(table["nis"])),
            nis_dof=int(np.sum(table["nis_dof"])),
            left_out=int(np.sum(table.get("left_out", 0))),
            ms=array("d", table["ms"].tolist()),
        )

    def add(self, row: Row) -> None:
        """Count a step."""
        self.steps += 1
        self.frozen_steps += int(row["frozen"])
        self.observations += int(row["observed"])
        self.used += int(row["used"])
        self.rejected += int(row["rejected"])
        self.nis += row["nis"]
        self.nis_dof += int(row["nis_dof"])
        self.left_out += int(row["left_out"])
        self.ms.append(row["ms"])

    @property
    def rejected_fraction(self) -> float | None:
        """Share of the observations put to the gate that failed it; None where none was."""
        gated = self.used + self.rejected
        return self.rejected / gated if gated else None

    @property
    def nis_per_dof(self) -> float | None:
        """Normalised innovation squared by its degrees of freedom; 1 where the filter is right."""
        return self.nis / self.nis_dof if self.nis_dof else None

    def ms_percentile(self, percent: float) -> float | None:
        """Percentile of the steps' times, milliseconds."""
        return percentile(self.ms, percent)


def percentile(values: Sequence[float], percent: float) -> float | None:
    """Percentile of values; None where there are none."""
    return float(np.percentile(values, percent)) if len(values) else None
