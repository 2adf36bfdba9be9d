# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest

from vislam_ros.core.filters.registry import estimator_named, estimator_names
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings, SlamSettings, settings_from_dict
from vislam_ros.errors import SettingsError


def test_values_arrive_in_the_type_of_the_field():
    values = settings_from_dict(
        RobocentricSettings, {"chi2_gate": 9, "retire_after": 3, "pixel_variance": [1, 2, 3, 4]}
    )
    assert values.chi2_gate == 9.0
    assert isinstance(values.chi2_gate, float)
    assert values.retire_after == 3
    assert values.pixel_variance == (1.0, 2.0, 3.0, 4.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"chi_gate": 1.0}, ["chi_gate", "no such parameter", "did you mean chi2_gate?"]),
        ({"chi2_gate": "high"}, ["chi2_gate", "'high'", "number"]),
        ({"chi2_gate": -1.0}, ["chi2_gate", "-1.0", "between 0.0 and"]),
        ({"chi2_gate": float("nan")}, ["chi2_gate", "nan", "finite"]),
        ({"retire_after": 1.5}, ["retire_after", "1.5", "whole number"]),
        ({"retire_after": True}, ["retire_after", "True", "whole number"]),
        ({"track_continuity": 1}, ["track_continuity", "1", "true or false"]),
        ({"estimator": 3}, ["estimator", "3", "str"]),
        ({"pixel_variance": [1.0, 1.0]}, ["pixel_variance", "4 numbers"]),
        ({"pixel_variance": [1.0, 1.0, 0.0, 1.0]}, ["pixel_variance", "0.0", "out of range"]),
        ({"feature_fraction": 1.5}, ["feature_fraction", "1.5", "between 0.0 and 1.0"]),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(values, words):
    with pytest.raises(SettingsError) as caught:
        settings_from_dict(RobocentricSettings, values)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("cls", [SlamSettings, RobocentricSettings, PredictionSettings])
def test_every_default_lies_in_its_range_and_has_a_meaning(cls):
    defaults = dataclasses.asdict(cls())
    assert settings_from_dict(cls, defaults) == cls()
    for field in dataclasses.fields(cls):
        assert len(field.metadata["description"]) > 10


@pytest.mark.parametrize("name", estimator_names())
def test_every_number_has_a_range_that_names_what_is_meant(name):
    cls = estimator_named(name).settings
    for field in dataclasses.fields(cls):
        if type(field.default) in (float, int, tuple):
            low, high = field.metadata["minimum"], field.metadata["maximum"]
            assert low is not None, field.name
            assert high is not None, field.name
            beyond = 10**30 if type(field.default) is int else 1e200
            value = (beyond,) * 4 if isinstance(field.default, tuple) else beyond
            with pytest.raises(
                SettingsError, match=f"^{field.name}: .* between {low} and {high}$"
            ):
                settings_from_dict(cls, {field.name: value})


def test_a_whole_number_beyond_all_floats_is_no_finite_number():
    with pytest.raises(SettingsError, match=r"chi2_gate: 1.* is not a finite number"):
        settings_from_dict(RobocentricSettings, {"chi2_gate": 10**400})
