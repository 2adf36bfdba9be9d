# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings by name find their estimator, and what that does not use is told."""

import dataclasses
from typing import Any

import pytest

from vislam_ros.core.filters.flat_settings import (
    completed,
    replaced,
    slam_settings,
    unused_note,
    unused_settings,
)
from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.filters.mapping import MappingSettings
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.errors import SettingsError


def test_settings_are_those_of_the_estimator_that_is_named_among_them() -> None:
    assert slam_settings({}) == RobocentricSettings()
    values = {"estimator": "joint", "min_disparity": 2, "gyro_bias_std": 0.5}
    assert slam_settings(values) == JointSettings(min_disparity=2.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"estimator": "magic"}, ["estimator", "'magic'", "robocentric", "joint", "module:Class"]),
        ({"estimator": 3}, ["estimator", "3", "joint"]),
        ({"estimator": ["joint"]}, ["estimator", "joint"]),
        ({"min_disparty": 1.0}, ["min_disparty", "no such parameter", "min_disparity?"]),
        # Those of other estimators must be right, too.
        ({"min_disparity": "high"}, ["min_disparity", "'high'", "number"]),
        (
            {"estimator": "joint", "gyro_bias_std": -1.0},
            ["gyro_bias_std", "-1.0", "between 0.0 and"],
        ),
    ],
)
def test_a_wrong_name_or_value_is_told_in_a_line(values: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(SettingsError) as caught:
        slam_settings(values)
    assert "\n" not in str(caught.value)
    for word in words:
        assert word in str(caught.value)


def test_what_is_set_and_not_used_is_told_in_one_line_and_a_default_is_no_setting() -> None:
    values = {
        "process_noise": "constant",
        "planar": True,
        "min_disparity": 2,
        "landmark_prior_variance": 0.5,
        "chi2_gate": 9.0,
        "map_file": "",
    }
    assert unused_settings(values) == {
        "min_disparity": 2.0,
        "planar": True,
        "process_noise": "constant",
    }
    assert unused_note(values) == (
        "min_disparity, planar, process_noise: set, but not used by estimator robocentric"
    )
    assert unused_note({**values, "estimator": "mapping"}) is None


def test_a_session_takes_settings_of_every_session_or_those_of_its_estimator() -> None:
    assert completed(SlamSettings(seed=3)) == RobocentricSettings(seed=3)
    assert completed(MappingSettings(planar=True)) == MappingSettings(planar=True)
    assert replaced(RobocentricSettings(seed=3), estimator="joint") == JointSettings(seed=3)
    with pytest.raises(SettingsError, match="'joint' has JointSettings, not MappingSettings"):
        Slam(dataclasses.replace(MappingSettings(), estimator="joint"))
