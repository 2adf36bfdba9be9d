# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``vislam.launch.py`` starts: its plan runs here, itself where launch is installed."""

import ast
import dataclasses
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from live.node_processes import WAIT, wait_until
from places import REPOSITORY

from vislam_ros.cli.domain import local_graph, own_domain
from vislam_ros.cli.parameters import SETTINGS_OF_NODES
from vislam_ros.core.filters.flat_settings import setting_owners
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.errors import VislamError
from vislam_ros.nodes.launch_plan import SHOWN, Process, arguments, planned

LAUNCH_FILE = REPOSITORY / "vislam_ros" / "launch" / "vislam.launch.py"
STEPS = 30


def values(**told: str) -> dict[str, str]:
    """Values of all arguments: the defaults, but for those told."""
    defaults = {name: one.default for name, one in arguments(REPOSITORY).items()}
    assert told.keys() <= defaults.keys()
    return {**defaults, **told}


def by_name(plan: list[Process]) -> dict[str, Process]:
    return {process.executable: process for process in plan}


def test_every_argument_says_what_it_is_for_and_its_default_is_one_of_its_choices() -> None:
    for name, argument in arguments(REPOSITORY).items():
        assert len(argument.description.split()) > 2, name
        assert not argument.choices or argument.default in argument.choices
    assert Path(values()["params_file"]).is_file()
    assert Path(values()["rviz_config"]).is_file()


def test_a_robot_gets_the_two_nodes_and_what_it_asks_for() -> None:
    assert list(by_name(planned(values()))) == ["imu_prediction_node", "slam_node"]
    plan = by_name(planned(values(use_tracker="true", results="run", rviz="true", force="true")))
    assert list(plan) == [
        "imu_prediction_node",
        "slam_node",
        "stereo_tracker_node",
        "recorder_node",
        "rviz2",
    ]
    assert plan["recorder_node"].parameters["directory"] == "run"
    assert plan["recorder_node"].parameters["force"] is True
    assert plan["rviz2"].package == "rviz2"


def test_each_robot_gets_the_parameters_of_its_namespace(tmp_path: Path) -> None:
    file = tmp_path / "robots.yaml"
    robots = {f"/robot{n}/slam_node": {"ros__parameters": {"seed": n}} for n in (1, 2)}
    file.write_text(yaml.dump(robots))
    for number in (1, 2):
        told = values(params_file=str(file), namespace=f"robot{number}")
        assert by_name(planned(told))["slam_node"].parameters["seed"] == number
    with pytest.raises(VislamError, match=r"^\S*robots.yaml: .* differ in seed: "):
        planned(values(params_file=str(file)))


def test_with_the_tracker_slam_node_hears_the_cameras_that_it_rectifies() -> None:
    plan = by_name(planned(values(use_tracker="true", bag="bag")))
    told = dict(plan["slam_node"].remappings)
    assert told["stereo/left/camera_info"] == "stereo/rectified/left/camera_info"
    assert len(told) == 3
    assert plan["stereo_tracker_node"].remappings == ()
    assert plan["stereo_tracker_node"].parameters["queue_size"] == 0
    on_a_robot = by_name(planned(values(use_tracker="true")))
    assert on_a_robot["stereo_tracker_node"].parameters["queue_size"] > 0
    assert by_name(planned(values()))["slam_node"].remappings == ()


def test_a_replay_has_the_player_last_and_simulated_time_has_its_clock() -> None:
    plan = planned(values(bag="drive_bag", rate="2.0", use_sim_time="true"))
    assert plan[-1].arguments == ("play", "drive_bag", "--rate", "2.0", "--clock")
    assert all(process.parameters["use_sim_time"] for process in plan[:-1])


def test_a_namespace_holds_for_all_of_them_and_rviz_shows_its_topics() -> None:
    plan = by_name(planned(values(namespace="robot1", bag="bag", rviz="true")))
    assert plan["slam_node"].namespace == plan["imu_prediction_node"].namespace == "robot1"
    assert plan["vislam"].arguments[-2:] == ("--namespace", "/robot1")
    assert dict(plan["rviz2"].remappings)["/slam/odometry"] == "/robot1/slam/odometry"
    assert len(plan["rviz2"].remappings) == len(SHOWN)


def test_parameters_are_those_of_the_file_in_whatever_namespace(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("/robot1/slam_node: {ros__parameters: {chi2_gate: 9.0}}")
    plan = by_name(planned(values(params_file=str(path), namespace="robot1")))
    assert plan["slam_node"].parameters == {"chi2_gate": 9.0, "use_sim_time": False}


def test_what_will_not_do_is_told_by_name(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match=r"none\.yaml"):
        planned(values(params_file=str(tmp_path / "none.yaml")))
    with pytest.raises(VislamError, match=r"^rviz: 'maybe' is neither true nor false"):
        planned(values(rviz="maybe"))


def test_executables_and_their_parameters_exist() -> None:
    plan = planned(values(use_tracker="true", results="run", bag="bag"))
    setup = (REPOSITORY / "setup.py").read_text()
    for process in plan:
        assert f'"{process.executable} = ' in setup
        if process.executable in SETTINGS_OF_NODES:
            classes = SETTINGS_OF_NODES[process.executable]
            known = {field.name for cls in classes for field in dataclasses.fields(cls)}
            if process.executable == "slam_node":
                known |= setting_owners({}).keys()
            assert process.parameters.keys() <= known | {"use_sim_time"}


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Any]:
    """Start a plan's processes as the node action of launch does; they are gone after it."""
    running: dict[str, subprocess.Popen[str]] = {}

    def start(plan: list[Process], domain: int) -> dict[str, "subprocess.Popen[str]"]:
        environment = {**os.environ, **local_graph(), "ROS_DOMAIN_ID": str(domain)}
        modules = {"vislam": "cli.main"}
        for process in plan:
            file = tmp_path / f"{process.executable}.yaml"
            file.write_text(yaml.dump({"/**": {"ros__parameters": process.parameters}}))
            module = modules.get(process.executable, f"nodes.{process.executable}")
            told = [*process.arguments, "--ros-args", *process.ros_arguments]
            if process.namespace:
                told += ["-r", f"__ns:=/{process.namespace}"]
            if process.parameters:
                told += ["--params-file", str(file)]
            running[process.executable] = subprocess.Popen(
                [sys.executable, "-m", f"vislam_ros.{module}", *told],
                cwd=REPOSITORY,
                env=environment,
                stderr=subprocess.PIPE,
                text=True,
            )
        return running

    yield start
    for process in running.values():
        process.kill()
        process.communicate(timeout=WAIT)


def summary(results: Path) -> dict[str, Any]:
    return dict(json.loads((results / "summary.json").read_text()))


@pytest.mark.parametrize("namespace", ["", "robot1"])
def test_a_replay_by_the_plan_is_recorded_whole(
    started: Any, tmp_path: Path, namespace: str
) -> None:
    write_bag(simulate(SimulationSettings(steps=STEPS, landmarks=60)).drive, tmp_path / "bag")
    results = tmp_path / "run"
    told = {"bag": str(tmp_path / "bag"), "rate": "0", "results": str(results)}
    with own_domain() as domain:
        running = started(planned(values(**told, namespace=namespace)), domain)
        _, errors = running["vislam"].communicate(timeout=WAIT)
        assert running["vislam"].returncode == 0, errors
        wait_until(lambda: summary(results)["complete"], "the end of the recording")
        for name in ("recorder_node", "slam_node", "imu_prediction_node"):
            running[name].send_signal(signal.SIGINT)
            _, errors = running[name].communicate(timeout=WAIT)
            assert running[name].returncode == 0, errors
    assert summary(results)["steps"] == STEPS


def test_the_launch_file_names_what_launch_has_and_hands_over_every_field_of_the_plan() -> None:
    """All that can be said of it where launch is not installed."""
    tree = ast.parse(LAUNCH_FILE.read_text())
    functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    assert "generate_launch_description" in functions
    imported = {
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {("launch", "LaunchDescription"), ("launch_ros.actions", "Node")} <= imported
    read = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "process"
    }
    assert read == {field.name for field in dataclasses.fields(Process)}


def test_launch_itself_takes_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    launch = pytest.importorskip("launch", reason="needs launch, of a full ROS 2 installation")
    sources = pytest.importorskip("launch.launch_description_sources")
    pytest.importorskip("launch_ros")
    packages = pytest.importorskip("ament_index_python.packages")
    monkeypatch.setattr(packages, "get_package_share_directory", lambda _name: str(REPOSITORY))
    context = launch.LaunchContext()
    source = sources.PythonLaunchDescriptionSource(str(LAUNCH_FILE))
    description = source.get_launch_description(context)
    declared = {one.name: one for one in description.get_launch_arguments()}
    assert declared.keys() == arguments(REPOSITORY).keys()
    assert all(one.description for one in declared.values())
    context.launch_configurations.update(values(bag="bag", results="run", rviz="true"))
    opaque = description.entities[-1]
    assert len(opaque.execute(context)) == 5
