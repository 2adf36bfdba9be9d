# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands of README and tutorials run one after the other in an empty folder, as they stand."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from places import REPOSITORY

from vislam_ros.cli.domain import own_domain
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import read_tum

# A drive in real time would take a minute.
SHORTER = ["--steps", "80", "--landmarks", "400"]
SHORTER_IMAGES = ["--seconds", "2"]
# The player's own patience is that of an idle machine.
PATIENT = ["--wait", "60"]
# What needs a ROS installation or a clone; other tests parse it.
NOT_RUN = ("ros2", "make")
# A row of a table of a command's output, but for the names of parameters and findings.
LABEL = re.compile(r"^│ ([a-z][a-z ,/:\[\]]*?) +│", re.MULTILINE)


def section(page: str, heading: str = "") -> str:
    text = (REPOSITORY / page).read_text()
    return text.partition(f"## {heading}\n")[2].partition("\n## ")[0] if heading else text


def commands(text: str) -> list[list[str]]:
    """Words of the commands of a page's shell blocks, in its order."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def outputs(text: str) -> str:
    """All that a page shows of what commands say."""
    return "\n".join(re.findall(r"^```\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))


class Shell:
    """Runs commands in a folder: each to its end, but nodes, which run until the recorder ends."""

    def __init__(self, folder: Path, domain: int | None = None):
        self._folder = folder
        self._environment = {k: v for k, v in os.environ.items() if k != "ROS_DOMAIN_ID"}
        if domain is not None:
            self._environment |= {
                "ROS_DOMAIN_ID": str(domain),
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
                "FASTRTPS_DEFAULT_PROFILES_FILE": str(REPOSITORY / "config" / "fastdds.xml"),
            }
        self._nodes: dict[str, subprocess.Popen[str]] = {}
        self.said: dict[str, str] = {}

    def run(self, program: str, *words: str) -> None:
        if program.endswith("_node"):
            self._nodes[program] = self._start(f"nodes.{program}", *words)
            return
        assert program == "vislam"
        command, *options = words
        assert "--force" not in options
        file = None
        if ">" in options:
            *options, _, file = options
        if command == "simulate":
            options += SHORTER_IMAGES if "--images" in options else SHORTER
        if command == "play":
            options += PATIENT
        process = self._start("cli.main", command, *options)
        out, errors = process.communicate(timeout=120)
        assert process.returncode == 0, f"{command}: {errors}"
        if file:
            (self._folder / file).write_text(out)
        else:
            self.said[command] = self.said.get(command, "") + out

    def end_recording(self) -> None:
        """Ctrl-C to the recorder."""
        recorder = self._nodes.pop("recorder_node")
        recorder.send_signal(signal.SIGINT)
        out, errors = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, errors
        self.said["recorder_node"] = out + errors

    def close(self) -> None:
        for process in self._nodes.values():
            process.kill()
            process.communicate(timeout=60)

    def _start(self, module: str, *words: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-m", f"vislam_ros.{module}", *words],
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Shell]:
    shell = Shell(tmp_path)
    yield shell
    shell.close()


@pytest.fixture
def shell_of_a_graph(tmp_path: Path) -> Iterator[Shell]:
    with own_domain(os.getpid()) as domain:
        shell = Shell(tmp_path, domain)
        yield shell
        shell.close()


@pytest.mark.timeout(400)
def test_the_readmes_sequence_runs_from_top_to_bottom_in_an_empty_folder(
    shell: Shell, tmp_path: Path
) -> None:
    sequence = commands(section("README.md", "A drive, step by step"))
    assert [words[:2] for words in sequence[:2]] == [["vislam", "simulate"], ["vislam", "run"]]
    assert len(sequence) >= 9
    for words in sequence:
        shell.run(*words)
    for estimate in ("filtered", "smoothed", "dead reckoning"):
        assert estimate in shell.said["evaluate"]
    results = tmp_path / "results"
    live, offline = (results / name / "trajectory.tum" for name in ("live", "offline"))
    assert live.read_bytes() == offline.read_bytes()
    (exported,) = tmp_path.glob("*.csv")
    smoothed = np.loadtxt(exported, delimiter=",")
    assert len(smoothed) == len(read_tum(live))


@pytest.mark.timeout(400)
def test_the_students_tutorial_ends_with_its_figures(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra report is not installed")
    page = section("docs/tutorial_student.md")
    for words in commands(page):
        if words[0] not in NOT_RUN:
            shell.run(*words)
    results = tmp_path / "results"
    for name in ("trajectory.png", "steps.png", "estimates.png", "errors.png", "report.html"):
        assert (results / "drive" / name).is_file(), name
    assert (results / "sweep" / "sweep.png").is_file()
    assert "results/joint" in shell.said["evaluate"]
    assert set(LABEL.findall(outputs(page))) <= set(LABEL.findall("".join(shell.said.values())))


@pytest.mark.timeout(400)
def test_the_engineers_tutorial_ends_with_a_whole_recording(
    shell_of_a_graph: Shell, tmp_path: Path
) -> None:
    shell, page = shell_of_a_graph, section("docs/tutorial_robot.md")
    for words in commands(page):
        if words[0] not in NOT_RUN:
            shell.run(*words)
        if words[:2] == ["vislam", "play"]:
            shell.end_recording()
    results = tmp_path / "results"
    assert "results/robot: complete" in shell.said["recorder_node"]
    assert read_results(results / "robot").summary["complete"] is True
    poses = [read_tum(results / name / "trajectory.tum") for name in ("bag", "offline", "robot")]
    np.testing.assert_array_equal(poses[0].positions, poses[1].positions)
    assert len(poses[2]) == len(poses[1])
    assert (results / "robot" / "landmarks.ply").is_file()
    assert set(LABEL.findall(outputs(page))) <= set(LABEL.findall("".join(shell.said.values())))
