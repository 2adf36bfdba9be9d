# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers with a name, a unit and a meaning, of which the record of a step is made."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Column:
    """A number that each step has.

    Attributes
    ----------
    name : str
    kind : type
        ``int``, ``float`` or ``bool``.
    unit : str
        Empty where there is none.
    meaning : str
    """

    name: str
    kind: type
    unit: str
    meaning: str

    @property
    def label(self) -> str:
        """Name for people, with its unit."""
        return _label(self.name, self.unit)


@dataclass(frozen=True)
class Quantity:
    """What an estimator tells at every step besides pose and map: a number or a vector.

    Attributes
    ----------
    name, unit, meaning : str
    axes : tuple of str
        Names of a vector's components; empty for a number.
    has_std : bool
        Whether it comes with standard deviations. A noise level, which is one itself, does not.
    """

    name: str
    unit: str
    meaning: str
    axes: tuple[str, ...] = ()
    has_std: bool = True

    @property
    def label(self) -> str:
        """Name for people, with its unit."""
        return _label(self.name, self.unit)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Columns of the components."""
        return tuple(f"{self.name}{end}" for end in self._ends)

    @cached_property
    def std_names(self) -> tuple[str, ...]:
        """Columns of their standard deviations, which stand behind them."""
        return tuple(f"{self.name}_std{end}" for end in self._ends) if self.has_std else ()

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """All of them."""
        std_meaning = f"standard deviation of `{self.name}`"
        return (
            *(Column(name, float, self.unit, self.meaning) for name in self.names),
            *(Column(name, float, self.unit, std_meaning) for name in self.std_names),
        )

    @property
    def _ends(self) -> list[str]:
        return [f"_{axis}" for axis in self.axes] or [""]


class Estimate(NamedTuple):
    """A quantity as an estimator has it.

    Attributes
    ----------
    quantity : Quantity
    values : array_like, (k,), or float
    std : array_like, (k,), or float
        Standard deviations; empty where the quantity has none.
    """

    quantity: Quantity
    values: ArrayLike
    std: ArrayLike = ()

    def numbers(self) -> dict[str, float]:
        """Values and standard deviations by column.

        Raises
        ------
        ValueError
            Where they are more or fewer than the quantity's columns.
        """
        values, std = np.asarray(self.values, dtype=float), np.asarray(self.std, dtype=float)
        numbers: list[float] = values.ravel().tolist() + std.ravel().tolist()
        names = self.quantity.names + self.quantity.std_names
        if len(numbers) != len(names):
            raise ValueError(f"{len(numbers)} numbers for the columns {', '.join(names)}")
        return dict(zip(names, numbers, strict=True))


def _label(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return f"{words} [{unit}]" if unit else words
