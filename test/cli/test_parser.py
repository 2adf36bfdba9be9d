# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Wrong usage, help, and that flags say what the rest of the package means."""

import dataclasses
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
        [],
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
