# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which parameters of a file count."""

from pathlib import Path

import pytest

from vislam_ros.cli.parameters import RunParameters, report_unused, run_parameters
from vislam_ros.cli.parser import build_parser
from vislam_ros.errors import SettingsError, VislamError

ROBOTS = """\
/robot1/slam_node: {ros__parameters: {chi2_gate: 9.0}}
/robot2/slam_node: {ros__parameters: {chi2_gate: 16.0}}
"""


def parameters(tmp_path: Path, text: str, *flags: str) -> RunParameters:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    words = ["solve", "drive.npz", "--out", "results", "--params", str(file), *flags]
    return run_parameters(build_parser().parse_args(words))


@pytest.mark.parametrize(("robot", "gate"), [("/robot1", 9.0), ("/robot2", 16.0)])
def test_the_robot_that_is_named_has_its_own(robot: str, gate: float, tmp_path: Path) -> None:
    given = parameters(tmp_path, ROBOTS, "--namespace", robot).given
    assert given["slam_node"]["chi2_gate"] == gate


def test_of_several_robots_one_must_be_named(tmp_path: Path) -> None:
    words = "params.yaml: /robot1/slam_node and /robot2/slam_node differ in chi2_gate: "
    with pytest.raises(VislamError, match=words):
        parameters(tmp_path, ROBOTS)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--estimator=:",), "^--estimator: ':': "),
        (("--estimator=no_such:Thing",), "^--estimator: 'no_such:Thing': no_such cannot be"),
        (("--seed", "9" * 23), "^--seed: 9{23}"),
        ((), r"params\.yaml: slam_node: chi2_gate: "),
    ],
)
def test_an_error_names_the_flag_or_the_file_that_it_is_in(
    flags: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    text = f"slam_node: {{ros__parameters: {{chi2_gate: {9.0 if flags else -9.0}}}}}\n"
    with pytest.raises(SettingsError, match=words):
        parameters(tmp_path, text, *flags)


def test_a_misspelt_node_is_told_and_somebody_elses_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "{}: {{ros__parameters: {{chi2_gate: 9.0}}}}\n"
    report_unused(parameters(tmp_path, text.format("/robot1/slam_nod")))
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("note: ")
    assert line.endswith("slam_nod: no node of ours, it changes nothing; did you mean slam_node?")
    report_unused(parameters(tmp_path, text.format("camera_node")))
    assert not capsys.readouterr().err
