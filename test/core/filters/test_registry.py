# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimators are found by name, with settings of their own; what one does not use is known."""

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numerics import CAMERA

from vislam_ros.core.filters import registry
from vislam_ros.core.filters.flat_settings import (
    slam_settings,
    unused_settings,
)
from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.filters.registry import estimator_named, estimator_names, register_estimator
from vislam_ros.core.settings import SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import Solution, solve
from vislam_ros.errors import SettingsError

OUTSIDE = """
from dataclasses import dataclass
from vislam_ros import SlamSettings, register_estimator
from vislam_ros.core.filters.dead_reckoning import DeadReckoningEstimator

@dataclass(frozen=True)
class Gains(SlamSettings):
    gain: float = 0.5

class Mine(DeadReckoningEstimator):
    def __init__(self, settings, given):
        super().__init__(settings)
        self.gain = settings.gain

class Unregistered(Mine):
    pass

class OneArgument(Mine):
    def __init__(self, settings):
        pass

class NoStep:
    def __init__(self, settings, given):
        pass

for maker in (Mine, OneArgument, NoStep):
    register_estimator(maker.__name__, Gains, maker)
"""

# Another value than the default, at which each setting shows in the results of the drive below.
OTHER_VALUES: dict[str, Any] = {
    "process_noise": "constant",
    "velocity_noise_std": 0.1,
    "angular_velocity_noise_std": 0.005,
    "process_variance": 1e-3,
    "prior_pose_variance": 0.01,
    "retire_after": 3,
    "rest_after_rejection": 0,
    "max_active": 10,
    "track_continuity": False,
    "frozen_share": 1.0,
    "frozen_motion": 1e4,
    "feature_fraction": 0.5,
    "seed": 1,
    "pixel_variance": (2.0, 2.0, 2.0, 2.0),
    "chi2_gate": 4.0,
    "pixel_gate": 1.0,
    "landmark_initialization": "independent",
    "landmark_prior_variance": 2.0,
    "min_disparity": 10.0,
    "planar": True,
    "velocity_walk_std": 1.0,
    "angular_velocity_walk_std": 0.2,
    "gyro_bias_std": 0.0,
    "gyro_bias_walk_std": 0.01,
    "learn_noise": False,
    "lens_distortion_std": 0.0,
}
# Where a setting says something only together with another one.
TOGETHER_WITH: dict[str, dict[str, Any]] = {
    "process_variance": {"process_noise": "constant"},
    "landmark_prior_variance": {"landmark_initialization": "independent"},
    "seed": {"feature_fraction": 0.5},
}
# They tell which messages are taken, or which map, and have tests where that is done; and that its
# disparities keep their errors a drive shows after more steps than these.
ELSEWHERE = {"estimator", "time_jump", "max_pending", "map_file", "disparity_offset_std"}


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers goes with it; what the package registers stays."""
    for name in estimator_names():
        estimator_named(name)
    monkeypatch.setattr(registry, "_registered", dict(registry._registered))


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of a module in the current folder."""
    (tmp_path / "outside_estimators.py").write_text(OUTSIDE)
    (tmp_path / "broken_estimator.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield "outside_estimators"
    for name in ("outside_estimators", "broken_estimator"):
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(
        steps=40,
        landmarks=300,
        outlier_share=0.1,
        frozen_share=0.15,
        seed=1,
    ).drive


def figures(solution: Solution) -> list[np.ndarray]:
    """All that a solution tells but how long it took."""
    steps = [column for name, column in solution.steps.items() if name != "ms"]
    trajectory, landmarks = solution.trajectory, solution.landmarks
    assert trajectory.covariances is not None
    return [
        *steps,
        trajectory.positions,
        trajectory.quaternions,
        trajectory.covariances,
        landmarks.positions,
        landmarks.covariances,
    ]


def same(one: Solution, other: Solution) -> bool:
    return all(
        a.shape == b.shape and np.array_equal(a, b, equal_nan=True)
        for a, b in zip(figures(one), figures(other), strict=True)
    )


@pytest.mark.parametrize("name", estimator_names())
def test_each_estimator_of_the_package_registers_its_name_with_settings_of_its_own(
    name: str,
) -> None:
    registration = estimator_named(name)
    assert registration.name == registration.settings().estimator == name
    others = [estimator_named(other) for other in estimator_names() if other != name]
    assert registration.settings not in [other.settings for other in others]


@pytest.mark.parametrize("name", estimator_names())
def test_each_setting_of_an_estimator_moves_it_but_for_those_said_to_be_unused(
    name: str, drive: Drive
) -> None:
    registration = estimator_named(name)
    landmarks = solve(drive, JointSettings()).landmarks

    def solved(**values: Any) -> Solution:
        settings = slam_settings({"estimator": name, **values})
        return solve(drive, settings, given_map=landmarks)

    still = set()
    for setting in registration.setting_names - ELSEWHERE:
        given = TOGETHER_WITH.get(setting, {})
        if same(solved(**given), solved(**{**given, setting: OTHER_VALUES[setting]})):
            still.add(setting)
    assert still == set(registration.unused)


def test_an_estimator_of_a_file_in_the_current_folder_is_named_by_module_and_class(
    outside: str, drive: Drive
) -> None:
    name = f"{outside}:Mine"
    settings = slam_settings({"estimator": name, "gain": 2})
    assert (settings.estimator, type(settings).__name__) == (name, "Gains")
    assert vars(settings)["gain"] == 2.0
    assert len(solve(drive, settings).trajectory) == drive.steps
    # From then on its own name will do, too.
    assert estimator_named("Mine") is estimator_named(name)
    assert unused_settings({"estimator": "Mine", "gain": 2.0, "gyro_bias_std": 0.0}) == {
        "gyro_bias_std": 0.0
    }


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no_such_module:Mine", ["no_such_module cannot be imported", "ModuleNotFoundError"]),
        ("broken_estimator:Mine", ["broken_estimator cannot be imported", "ZeroDivisionError"]),
        ("outside_estimators:Yours", ["has no attribute 'Yours'"]),
        ("outside_estimators:Unregistered", ["not registered", "register_estimator"]),
        ("outside_estimators:OneArgument", ["'OneArgument' cannot be made", "TypeError"]),
        ("outside_estimators:NoStep", ["'NoStep' has no", "T_world_body", "step"]),
        (":", ["':'"]),
    ],
)
@pytest.mark.usefixtures("outside")
def test_a_bad_estimator_is_told_in_a_line(name: str, words: list[str], drive: Drive) -> None:
    with pytest.raises(SettingsError) as caught:
        solve(drive, SlamSettings(estimator=name))
    assert "\n" not in str(caught.value)
    for word in ["estimator: ", *words]:
        assert word in str(caught.value)


@dataclasses.dataclass(frozen=True)
class Incomplete(SlamSettings):
    """Settings with one that has no default."""

    gain: float = dataclasses.field(kw_only=True)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("joint", SlamSettings, "joint: is the name of an estimator of this package"),
        ("mine", dict, "no subclass of SlamSettings"),
        ("mine", Incomplete, "needs a default"),
    ],
)
def test_what_cannot_be_registered_is_refused(name: str, settings: Any, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        register_estimator(name, settings, lambda settings, given: settings)


def test_a_made_estimator_has_all_parts_of_one() -> None:
    given = registry.Surroundings(CAMERA, None, None, lambda keys: keys.astype(np.uint32))
    for name in set(estimator_names()) - {"localization"}:
        registration = estimator_named(name)
        registration.made(registration.settings(), given)
