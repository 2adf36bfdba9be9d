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
from vislam_ros.core.filters.flat_settings import unused_settings
from vislam_ros.core.filters.registry import estimator_named, estimator_names
from vislam_ros.core.settings import SlamSettings, is_live, settings_from_dict
from vislam_ros.data.files.parameter_file import read_parameters

CONFIG = REPOSITORY / "config"


def names_of(cls: type[Any]) -> set[str]:
    return {field.name for field in dataclasses.fields(cls)}


def classes_of(node: str) -> list[Any]:
    """Settings classes that a node takes parameters of, those of every estimator included."""
    estimators = [estimator_named(name).settings for name in estimator_names()]
    return [*SETTINGS_OF_NODES[node], *(estimators if node == "slam_node" else [])]


@pytest.mark.parametrize("file", ["ekf.yaml", "report_table1.yaml"])
def test_every_parameter_in_a_file_is_declared_and_valid(file: str) -> None:
    for node, values in read_parameters(CONFIG / file).items():
        assert values.keys() <= set().union(*map(names_of, classes_of(node)))
        for cls in classes_of(node):
            settings_from_dict(cls, {k: v for k, v in values.items() if k in names_of(cls)})


def test_the_recommended_file_names_every_parameter() -> None:
    parameters = read_parameters(CONFIG / "ekf.yaml")
    for node in SETTINGS_OF_NODES:
        assert parameters[node].keys() == set().union(*map(names_of, classes_of(node)))


def test_the_recommended_values_are_the_defaults_of_every_estimator() -> None:
    for node, values in read_parameters(CONFIG / "ekf.yaml").items():
        for cls in classes_of(node):
            own = {k: v for k, v in values.items() if k in names_of(cls)}
            if issubclass(cls, SlamSettings):
                own["estimator"] = cls().estimator
            assert settings_from_dict(cls, own) == cls()


def test_the_report_s_table_sets_nothing_that_its_filter_does_not_use() -> None:
    assert unused_settings(read_parameters(CONFIG / "report_table1.yaml")["slam_node"]) == {}


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


def test_the_page_names_what_can_be_set_while_slam_node_runs_and_nothing_else() -> None:
    page = (REPOSITORY / "docs" / "parameters.md").read_text(encoding="utf-8")
    section = page[page.index("## While it runs") :]
    table = section[section.index("| group |") :].split("\n\n")[0]
    live = {
        field.name
        for cls in classes_of("slam_node")
        for field in dataclasses.fields(cls)
        if is_live(field)
    }
    assert set(re.findall(r"`(\w+)`", table)) == live
