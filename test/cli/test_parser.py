# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Wrong usage, help, and that flags say what the rest of the package means."""

import dataclasses
import os
import subprocess
import sys
from typing import get_args

import pytest

from vislam_ros import __version__
from vislam_ros.cli.grammar import shared
from vislam_ros.cli.main import main
from vislam_ros.cli.parser import build_parser
from vislam_ros.data.datasets import conventions
from vislam_ros.data.datasets.extrinsics import READINGS
from vislam_ros.data.evaluation.alignment import ALIGNMENTS
from vislam_ros.data.evaluation.association import MAX_DIFFERENCE
from vislam_ros.data.evaluation.laid_paths import LAYINGS
from vislam_ros.data.pictures.results import PictureFormat
from vislam_ros.data.simulation.simulate import SimulationSettings
from vislam_ros.data.trajectory_files import FILE_FORMATS
from vislam_ros.nodes.player.options import PlayOptions

COMMANDS = ("simulate", "convert", "play", "run", "solve", "evaluate", "export", "plot", "verify")


@pytest.mark.parametrize(
    "argv",
    [
        ["fly"],
        ["solve", "drive.npz"],
        ["solve", "drive.npz", "--out", "r", "--estimator", "magic"],
        ["solve", "drive.npz", "--out", "r", "--fraction", "1.5"],
        ["solve", "drive.npz", "--out", "r", "--fraction", "nan"],
        ["run", "drive.npz", "--out", "r", "--rate", "-1"],
        ["run", "drive.npz", "--out", "r", "--seed", "0.5"],
        ["play", "bag", "--rate", "fast"],
        ["play", "bag", "--remap", "imu"],
        ["play", "bag", "--loop", "0"],
        ["convert", "drive.npz", "bag", "--imu-frame", "enu"],
        ["simulate", "d.npz", "--gyro-bias", "0.1"],
        ["evaluate", "results"],
    ],
)
def test_wrong_usage_exits_with_2(argv, capsys):
    with pytest.raises(SystemExit) as caught:
        main(argv)
    assert caught.value.code == 2
    assert capsys.readouterr().err.startswith("usage: vislam")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_examples_that_parse(command, capsys):
    with pytest.raises(SystemExit) as caught:
        main([command, "--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    examples = [line.split("   ")[0] for line in text.splitlines() if "vislam " + command in line]
    examples = [line.strip() for line in examples if line.startswith("  vislam")]
    assert examples
    for example in examples:
        words = example.split(">")[0].split()
        assert build_parser().parse_args(words[1:]).command == command


@pytest.mark.parametrize(
    ("argv", "suggestion"),
    [
        (["slove", "drive.npz"], "did you mean solve?"),
        (["--versoin"], "did you mean --version, not --versoin?"),
        (["solve", "d.npz", "--out", "r", "--smoth"], "did you mean --smooth, not --smoth?"),
        (["solve", "d.npz", "--ot=r"], "did you mean --out, not --ot?"),
        (["evaluate", "r", "--refrence", "a"], "did you mean --reference, not --refrence?"),
        (["play", "bag", "--rats", "0", "--ros-args", "--lop"], "--rate, not --rats?"),
        (["run", "d.npz", "--out", "r", "--loop"], "arguments: --loop; vislam play has --loop"),
        (["run", "d.npz", "--out=r", "--align=se3"], "; vislam evaluate, plot have --align"),
        (["plot", "r", "--refernce", "a"], "did you mean --reference, not --refernce?"),
    ],
)
def test_a_typo_is_answered_with_what_was_meant(argv, suggestion, capsys):
    with pytest.raises(SystemExit) as caught:
        main(argv)
    assert caught.value.code == 2
    text = capsys.readouterr().err
    assert text.endswith(f"{suggestion}\n")
    if argv[0] in COMMANDS:
        assert text.startswith(f"usage: vislam {argv[0]} ")


@pytest.mark.parametrize(
    "argv",
    [
        ["xyzzy"],
        ["solve", "drive.npz", "--out", "r", "--xyzzy"],
        ["run", "drive.npz", "--out", "r", "--loop"],
        ["run", "drive.npz", "--out", "r", "--h-"],
        ["solve", "drive.npz", "--smo"],
        ["solve", "slove"],
    ],
)
def test_what_is_like_nothing_or_no_typo_gets_no_suggestion(argv, capsys):
    with pytest.raises(SystemExit):
        main(argv)
    assert "did you mean" not in capsys.readouterr().err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_argument_has_a_help_text(command):
    (commands,) = (action for action in build_parser()._actions if action.dest == "command")
    parser = commands.choices[command]
    assert [action.dest for action in parser._actions if not action.help] == []


def test_without_a_command_it_prints_the_help_with_three_commands_to_begin_with(capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--help"])
    assert capsys.readouterr().out == text
    examples = [line.split("   ")[0].split() for line in text.splitlines() if "  vislam " in line]
    assert [words[1] for words in examples] == ["simulate", "run", "evaluate"]
    for words in examples:
        assert build_parser().parse_args(words[1:]).command == words[1]


@pytest.mark.parametrize(
    ("line", "completions"),
    [
        ("vislam so", {"solve"}),
        ("vislam s", {"simulate", "solve", "sweep"}),
        ("vislam solve --sm", {"--smooth"}),
        ("vislam evaluate r --align ", {"se3", "yaw", "none"}),
    ],
)
def test_the_shell_is_told_what_may_follow(line, completions, tmp_path):
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "completions"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    program = [sys.executable, "-m", "vislam_ros.cli.main"]
    subprocess.run(program, env=environment, cwd=tmp_path, timeout=60, check=True)
    told = (tmp_path / "completions").read_text().split("\n")
    assert {text.strip() for text in told if text.strip()} == completions


def test_the_version_is_the_packages(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--version"])
    assert caught.value.code == 0
    assert capsys.readouterr().out == f"vislam {__version__}\n"


def test_play_has_a_flag_for_each_option_with_its_default():
    arguments = build_parser().parse_args(["play", "bag"])
    for field in dataclasses.fields(PlayOptions):
        assert getattr(arguments, field.name) == field.default, field.name


def test_simulate_leaves_the_defaults_to_the_simulation_and_tells_them(capsys):
    arguments = build_parser().parse_args(["simulate", "drive.npz"])
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    for field in dataclasses.fields(SimulationSettings):
        assert getattr(arguments, field.name) is None
        values = field.default if isinstance(field.default, tuple) else (field.default,)
        assert f"({' '.join(f'{value:g}' for value in values)})" in text, field.name


def test_choices_of_reading_are_those_of_the_reader():
    assert shared.IMU_FRAMES == conventions.IMU_FRAMES
    assert shared.TWIST_INDICES == conventions.TWIST_INDICES
    assert shared.TWIST_ORIGINS == conventions.TWIST_ORIGINS
    assert shared.EXTRINSICS == conventions.EXTRINSICS == ("auto", *READINGS)


def test_choices_of_evaluation_are_those_of_the_evaluation():
    assert shared.ALIGNMENTS == ALIGNMENTS
    assert shared.MAX_DIFFERENCE == MAX_DIFFERENCE
    assert shared.FILE_FORMATS == FILE_FORMATS
    assert shared.LAYINGS == LAYINGS
    assert get_args(PictureFormat) == shared.PICTURE_FORMATS


def test_loop_and_clock_need_no_number():
    arguments = build_parser().parse_args(["play", "bag", "--loop", "--clock"])
    assert arguments.passes == 0
    assert arguments.clock_rate > 0.0
