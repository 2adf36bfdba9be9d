# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import functools
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from benchmark.battery.mechanisms import MECHANISMS
from benchmark.battery.rows import Simulated
from benchmark.battery.trials import Trial, TrialSettings, run_trial

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings

TRIAL = Trial(Simulated("walk", 6, gyro=True), 0)
SETTINGS = TrialSettings(
    Path("nowhere"), RobocentricSettings(), PredictionSettings(), smooth=False
)


def figures(without: str | None) -> dict[str, Any]:
    row = run_trial(replace(SETTINGS, without=without), TRIAL)
    assert row["error"] is None
    return {name: value for name, value in row.items() if name != "cpu_s"}


@functools.cache
def as_it_is() -> dict[str, Any]:
    return figures(None)


@pytest.mark.parametrize(
    "name",
    ["learned noise", "heavy tails", "sums of innovations", "tempered bias", "bias against none"],
)
def test_without_a_mechanism_the_estimate_is_another(
    name: str,
) -> None:
    without, whole = figures(name), as_it_is()
    assert without["estimate_m"] != whole["estimate_m"]
    assert without["dead_reckoning_m"] == whole["dead_reckoning_m"]


def test_afterwards_all_mechanisms_are_on_again() -> None:
    before = as_it_is()
    figures("tempered bias")
    assert figures(None) == before


@pytest.mark.parametrize("name", MECHANISMS)
def test_each_mechanism_can_be_switched_off(name: str) -> None:
    mechanism = MECHANISMS[name]
    settings = replace(RobocentricSettings(), **mechanism.settings)
    assert (settings != RobocentricSettings()) == bool(mechanism.settings)
    with mechanism.off():
        pass
