# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sweep runs: every point of a grid of settings, with every seed, in a fixed order."""

import dataclasses
import functools
import hashlib
import itertools
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from vislam_ros.core.filters.flat_settings import slam_settings, unused_note, unused_settings
from vislam_ros.core.settings import PredictionSettings, SlamSettings, changed
from vislam_ros.data.simulation.simulate import SimulationSettings
from vislam_ros.errors import SettingsError

SLAM, PREDICTION, SIMULATION = "slam_node", "imu_prediction_node", "simulate"

#: Name of a swept setting, such as ``slam_node.chi2_gate`` -> one of its values.
Point = dict[str, Any]

S = TypeVar("S")


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep.

    Attributes
    ----------
    key : str
        Hash of all its settings, whether or not they are swept.
    point : dict
        Values of the swept settings.
    seed : int
    slam, prediction : SlamSettings, PredictionSettings
    simulation : SimulationSettings or None
        The drive to simulate; None where a recorded one is given.
    """

    key: str
    point: Point
    seed: int
    slam: SlamSettings
    prediction: PredictionSettings
    simulation: SimulationSettings | None


@dataclass(frozen=True)
class SweepPlan:
    """A grid of settings and the seeds to run at each of its points.

    The seed is that of the simulation or, with a recorded drive, of the choice of tracks. Where
    all tracks are used it chooses nothing, and one run stands for all seeds.

    Attributes
    ----------
    slam : mapping of str to Any
        What is not swept, of whatever estimator.
    prediction : PredictionSettings
    simulation : SimulationSettings or None
        As for a run.
    grid : mapping of str to sequence
        Name of a setting, ``slam_node.NAME``, ``imu_prediction_node.NAME`` or
        ``simulate.NAME``, to its values; a single value is set and not swept.
    seeds : tuple of int

    Raises
    ------
    SettingsError
        Naming the setting and the value that will not do.
    """

    slam: Mapping[str, Any]
    prediction: PredictionSettings
    simulation: SimulationSettings | None = None
    grid: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        for name, values in self.grid.items():
            if not values:
                raise SettingsError(f"{name}: has no value to sweep")
            for value in values:
                self._settings({name: value}, 0)
        if not self.seeds or min(self.seeds) < 0:
            raise SettingsError(f"seeds: {list(self.seeds)} is not a list of whole numbers from 0")

    @property
    def axes(self) -> dict[str, tuple[Any, ...]]:
        """The settings with more than one value."""
        return {name: values for name, values in self.grid.items() if len(values) > 1}

    def points(self) -> list[Point]:
        """Return every point of the grid, the last setting changing fastest."""
        return [
            dict(zip(self.axes, values, strict=True))
            for values in itertools.product(*self.axes.values())
        ]

    def unused_notes(self) -> list[str]:
        """Return a line for each estimator that does not use all that it is given."""
        unused: dict[str, dict[str, Any]] = {}
        for point in self.points():
            values = self._slam_values(point)
            estimator = values.get("estimator", SlamSettings.estimator)
            unused.setdefault(estimator, {}).update(unused_settings(values))
        notes = (unused_note({**values, "estimator": name}) for name, values in unused.items())
        return [note for note in notes if note]

    def _slam_values(self, point: Point) -> dict[str, Any]:
        """Settings of estimators at a point, used or not."""
        return {**self.slam, **self._given(self._fixed | point)[SLAM]}

    @property
    def _fixed(self) -> Point:
        """The settings with one value."""
        return {name: values[0] for name, values in self.grid.items() if len(values) == 1}

    @functools.cached_property
    def runs(self) -> list[SweepRun]:
        """All runs, point by point; those with equal settings only once."""
        runs: dict[str, SweepRun] = {}
        for point in self.points():
            for seed in self.seeds:
                slam, prediction, simulation = self._settings(self._fixed | point, seed)
                unused = unused_settings(self._slam_values(point))
                key = _hash(unused, slam, prediction, simulation)
                shown = simulation.seed if simulation else slam.seed
                run = SweepRun(key, point, shown, slam, prediction, simulation)
                runs.setdefault(key, run)
        return list(runs.values())

    @staticmethod
    def _given(point: Point) -> dict[str, dict[str, Any]]:
        """Values of a point by owner and setting."""
        given: dict[str, dict[str, Any]] = {SLAM: {}, PREDICTION: {}, SIMULATION: {}}
        for name, value in point.items():
            owner, _, setting = name.partition(".")
            if owner not in given or not setting:
                raise SettingsError(
                    f"{name}: cannot be swept: write {SLAM}.NAME, {PREDICTION}.NAME or "
                    f"{SIMULATION}.NAME"
                )
            given[owner][setting] = value
        return given

    def _settings(
        self, point: Point, seed: int
    ) -> tuple[SlamSettings, PredictionSettings, SimulationSettings | None]:
        """Put a point and a seed over what is not swept."""
        given = self._given(point)
        if self.simulation is None and given[SIMULATION]:
            raise SettingsError(
                f"{next(iter(point))}: the drive is recorded, not simulated: leave DATA out and "
                "add --simulate"
            )
        slam = _checked(SLAM, given[SLAM], lambda values: slam_settings({**self.slam, **values}))
        prediction = _replaced(PREDICTION, self.prediction, given[PREDICTION])
        if self.simulation is not None:
            simulation = _replaced(SIMULATION, self.simulation, given[SIMULATION])
            return slam, prediction, dataclasses.replace(simulation, seed=seed)
        chooses = 0.0 < slam.feature_fraction < 1.0
        return dataclasses.replace(slam, seed=seed if chooses else 0), prediction, None


def _replaced(owner: str, settings: Any, values: Mapping[str, Any]) -> Any:
    """Put values over settings, checked."""
    return _checked(owner, values, lambda values: changed(settings, **values))


def _checked(owner: str, values: Mapping[str, Any], make: Callable[[Mapping[str, Any]], S]) -> S:
    """Make settings of values; errors name whose they are."""
    if "seed" in values:
        raise SettingsError(f"{owner}.seed: is set by the seeds of the sweep, not by its grid")
    try:
        return make(values)
    except SettingsError as error:
        raise SettingsError(f"{owner}.{error}") from error


def _hash(unused: Mapping[str, Any], *settings: Any) -> str:
    content = [None if part is None else dataclasses.asdict(part) for part in settings]
    if unused:
        content.append(dict(unused))
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]
