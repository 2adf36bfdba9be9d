# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameter files in config/ are whole, valid and explained."""

import dataclasses
import itertools
import re
from typing import Any

import pytest
from places import REPOSITORY

from vislam_ros.cli.parameters import SETTINGS_OF_NODES
from vislam_ros.core.settings import settings_from_dict
from vislam_ros.data.files.parameter_file import read_parameters

CONFIG = REPOSITORY / "config"


def names_of(cls: type[Any]) -> set[str]:
    return {field.name for field in dataclasses.fields(cls)}


@pytest.mark.parametrize("file", ["ekf.yaml", "report_table1.yaml"])
def test_every_parameter_in_a_file_is_declared_and_valid(file: str) -> None:
    for node, values in read_parameters(CONFIG / file).items():
        assert values.keys() <= set().union(*map(names_of, SETTINGS_OF_NODES[node]))
        for cls in SETTINGS_OF_NODES[node]:
            settings_from_dict(cls, {k: v for k, v in values.items() if k in names_of(cls)})


def test_the_recommended_file_names_every_parameter() -> None:
    parameters = read_parameters(CONFIG / "ekf.yaml")
    for node, classes in SETTINGS_OF_NODES.items():
        assert parameters[node].keys() == set().union(*map(names_of, classes))


def test_every_recommended_parameter_has_a_comment_above_it() -> None:
    lines = (CONFIG / "ekf.yaml").read_text().splitlines()
    for above, line in itertools.pairwise(lines):
        if re.match(r" {4}\w+:", line):
            assert above.strip().startswith("#") or re.match(r" {4}\w+:", above), line


def test_table_1_of_the_report_is_given_exactly() -> None:
    slam = read_parameters(CONFIG / "report_table1.yaml")["slam_node"]
    assert slam["landmark_prior_variance"] == 0.5
    assert slam["prior_pose_variance"] == 0.01
    assert slam["pixel_variance"] == [100.0] * 4
    assert slam["process_variance"] == 1e-10
