# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What `colcon build` installs is what `ros2 run` starts."""

import dataclasses
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from places import REPOSITORY

from vislam_ros.cli.domain import own_domain
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings

EXECUTABLES = ("imu_prediction_node", "recorder_node", "slam_node", "vislam")


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install base of a fresh colcon build of the package."""
    if importlib.util.find_spec("colcon_ros") is None:
        pytest.skip("needs colcon: pip install '.[colcon]'")
    base = tmp_path_factory.mktemp("colcon")
    build = subprocess.run(
        # The scripts that colcon installs start the Python that runs colcon.
        [
            *(sys.executable, "-m", "colcon", "--log-base", base / "log"),
            *("build", "--paths", REPOSITORY),
            *("--build-base", base / "build", "--install-base", base / "install"),
        ],
        cwd=base,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert build.returncode == 0, build.stdout + build.stderr
    return base / "install"


@pytest.fixture(scope="module")
def environment(install: Path) -> dict[str, str]:
    """Environment of a shell that has sourced the install base."""
    shell = subprocess.run(
        ["sh", "-c", '. "$0/setup.sh" && env -0', install],
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    return dict(entry.split("=", 1) for entry in shell.stdout.split("\0") if "=" in entry)


def test_the_package_and_its_executables_are_where_ros2_run_looks(
    install: Path, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    packages = pytest.importorskip("ament_index_python.packages")
    monkeypatch.setenv("AMENT_PREFIX_PATH", environment["AMENT_PREFIX_PATH"])
    prefix = Path(packages.get_package_prefix("vislam_ros"))
    assert prefix == install / "vislam_ros"
    for name in EXECUTABLES:
        assert os.access(prefix / "lib" / "vislam_ros" / name, os.X_OK), name
    share = Path(packages.get_package_share_directory("vislam_ros"))
    for path in (REPOSITORY / "config").iterdir():
        assert (share / "config" / path.name).read_bytes() == path.read_bytes()
    launch_file = REPOSITORY / "vislam_ros" / "launch" / "vislam.launch.py"
    assert (share / "launch" / launch_file.name).read_bytes() == launch_file.read_bytes()


def test_the_installed_command_runs_the_installed_modules(
    install: Path, environment: dict[str, str], tmp_path: Path
) -> None:
    where = subprocess.run(
        [sys.executable, "-c", "import vislam_ros; print(vislam_ros.__file__)"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=30,
        check=True,
    )
    assert Path(where.stdout.strip()).is_relative_to(install)
    command = subprocess.run(
        [install / "vislam_ros" / "lib" / "vislam_ros" / "vislam", "--help"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert command.returncode == 0, command.stderr
    assert "simulate" in command.stdout


def test_vislam_is_on_the_path_of_whoever_sources_the_workspace(
    install: Path, environment: dict[str, str]
) -> None:
    if importlib.util.find_spec("colcon_metadata") is None:
        pytest.skip("needs colcon-metadata, which reads colcon.pkg: pip install '.[colcon]'")
    folder = install / "vislam_ros" / "lib" / "vislam_ros"
    assert environment["PATH"].split(os.pathsep)[0] == str(folder)
    assert shutil.which("vislam", path=environment["PATH"]) == str(folder / "vislam")


def test_the_installed_slam_node_starts_with_ekf_yaml_and_answers_for_its_parameters(
    install: Path,
    environment: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rclpy = pytest.importorskip("rclpy")
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter_client import AsyncParameterClient

    prefix = install / "vislam_ros"
    parameters = prefix / "share" / "vislam_ros" / "config" / "ekf.yaml"
    wanted = yaml.safe_load(parameters.read_text())["slam_node"]["ros__parameters"]
    # The parameter service of ROS keeps the order of the names. The node declares what the chosen
    # estimator has; the file holds the others', too.
    declared = {field.name for field in dataclasses.fields(RobocentricSettings)}
    names = sorted(wanted.keys() & declared)
    assert "estimator" in names

    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    output = tmp_path / "slam_node.txt"
    with own_domain() as domain, output.open("w") as log:
        process = subprocess.Popen(
            [
                *(prefix / "lib" / "vislam_ros" / "slam_node", "--ros-args"),
                *("--params-file", parameters),
            ],
            cwd=tmp_path,
            env={
                **environment,
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
                "ROS_DOMAIN_ID": str(domain),
                "ROS_LOG_DIR": str(tmp_path),
            },
            stdout=log,
            stderr=subprocess.STDOUT,
        )
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        try:
            node = rclpy.create_node("asker", context=context)
            client = AsyncParameterClient(node, "slam_node")
            # Compiled loops are made anew in each new place.
            assert client.wait_for_services(timeout_sec=90.0), output.read_text()
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
            # An answer is lost where the server has not yet found the asker: ask again.
            deadline = time.monotonic() + 40.0
            answer = client.get_parameters(names)
            executor.spin_until_future_complete(answer, timeout_sec=5.0)
            while not answer.done() and time.monotonic() < deadline:
                answer = client.get_parameters(names)
                executor.spin_until_future_complete(answer, timeout_sec=5.0)
            assert answer.done(), output.read_text()
            values = [
                rclpy.parameter.parameter_value_to_python(value)
                for value in answer.result().values
            ]
            assert dict(zip(names, values, strict=True)) == {name: wanted[name] for name in names}
            executor.shutdown()
            node.destroy_node()

            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=20) == 0, output.read_text()
        finally:
            process.kill()
            process.wait()
            rclpy.try_shutdown(context=context)
