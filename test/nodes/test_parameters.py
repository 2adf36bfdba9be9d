# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.files.parameter_file import (
    node_parameters,
    read_parameters,
    write_parameters,
)
from vislam_ros.errors import SettingsError
from vislam_ros.nodes.parameters import (
    declare_settings,
    declare_slam_settings,
    undeclared_overrides,
)
from vislam_ros.nodes.settings import SlamOutputSettings


@pytest.fixture
def node_with(make_node):
    def make(**parameters):
        class PlainNode(Node):
            def __init__(self, **options):
                super().__init__("plain", **options)

        return make_node(PlainNode, **parameters)

    return make


def test_defaults_are_those_of_the_dataclass(node_with):
    node = node_with()
    assert declare_settings(node, RobocentricSettings) == RobocentricSettings()
    for field in dataclasses.fields(RobocentricSettings):
        assert node.describe_parameter(field.name).description.startswith(
            field.metadata["description"]
        )


def test_overrides_reach_the_settings_and_whole_numbers_count_as_doubles(node_with):
    node = node_with(velocity_noise_std=2, pixel_variance=[1, 2, 3, 4], track_continuity=False)
    settings = declare_settings(node, RobocentricSettings)
    assert settings.velocity_noise_std == 2.0
    assert settings.pixel_variance == (1.0, 2.0, 3.0, 4.0)
    assert settings.track_continuity is False
    assert node.get_parameter("velocity_noise_std").value == 2.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("velocity_noise_std", -1.0),
        ("velocity_noise_std", "fast"),
        ("estimator", "magic"),
        ("feature_fraction", 1.5),
        ("retire_after", 1.5),
        ("pixel_variance", [1.0]),
    ],
)
def test_a_bad_value_is_refused_in_one_line_that_names_it(node_with, name, value):
    node = node_with(**{name: value})
    with pytest.raises(SettingsError) as error:
        declare_slam_settings(node)
    message = str(error.value)
    assert name in message
    assert "\n" not in message


def test_what_another_estimator_alone_uses_is_told_in_a_line_and_not_declared(node_with, capfd):
    node = node_with(estimator="joint", min_disparity=2.0, learn_noise=False, gyro_bias_std=0.02)
    settings = declare_slam_settings(node)
    assert settings == JointSettings(min_disparity=2.0)
    assert not node.has_parameter("learn_noise")
    (line,) = capfd.readouterr().err.splitlines()
    assert line.endswith("learn_noise: set, but not used by estimator joint")


def test_what_cannot_change_at_run_time_is_read_only(node_with):
    node = node_with()
    declare_settings(node, PredictionSettings)
    result = node.set_parameters([Parameter("time_jump", value=2.0)])[0]
    assert not result.successful
    assert node.get_parameter("time_jump").value == PredictionSettings().time_jump


def test_what_may_change_at_run_time_is_checked_and_told(node_with):
    node = node_with()
    told = []
    declare_settings(node, SlamOutputSettings, told.append)
    assert node.set_parameters([Parameter("path_length", value=5)])[0].successful
    assert not node.set_parameters([Parameter("path_length", value=-5)])[0].successful
    assert not node.set_parameters([Parameter("landmarks_period", value=-1.0)])[0].successful
    assert told == [SlamOutputSettings(path_length=5)]


def test_names_that_are_not_declared_are_found_with_what_was_meant(node_with):
    node = node_with(estimater="joint", unlike_any=1)
    declare_settings(node, SlamSettings)
    assert undeclared_overrides(node) == {
        "estimater": "; did you mean estimator?",
        "unlike_any": "",
    }


@pytest.mark.parametrize("namespace", ["", "robot1", "house/robot1"])
@pytest.mark.parametrize(
    "section",
    [
        *("/**", "/*", "/**/slam_node", "/*/slam_node", "/robot1/slam_node"),
        *("/robot1/**", "/robot1/*", "/**/robot1/slam_node", "/house/**", "/house/*/slam_node"),
    ],
)
def test_a_file_s_section_counts_offline_where_ros_has_it_count(
    tmp_path, domain_id, namespace, section
):
    """Where there is something for the robot; what has no namespace counts for each, besides."""
    own = f"{f'/{namespace}' if namespace else ''}/slam_node"
    sections = {own: {"seed": 1}}
    sections.setdefault(section, {})["max_active"] = 7
    path = tmp_path / "params.yaml"
    write_parameters(path, sections)
    context = Context()
    arguments = ["--ros-args", "-r", f"__ns:=/{namespace}", "--params-file", str(path)]
    rclpy.init(args=arguments, context=context, domain_id=domain_id)
    node = Node("slam_node", context=context)
    heard = node.declare_parameter("max_active", 0).value
    node.destroy_node()
    rclpy.shutdown(context=context)
    offline = node_parameters(read_parameters(path), "slam_node", namespace)
    assert offline.get("max_active", 0) == heard
