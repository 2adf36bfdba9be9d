# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam evaluate``: one table for several runs, and the figures of evo."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evo_commands import evo_statistics
from places import SHARED_CASES

from vislam_ros.cli.main import main
from vislam_ros.data.trajectory import Trajectory, read_tum, write_tum
from vislam_ros.data.trajectory_files import write_trajectory

SEEDS = (1, 2, 3)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with three drives, each with its truth and what solve makes of it."""
    folder = tmp_path_factory.mktemp("runs")
    for seed in SEEDS:
        drive = folder / f"{seed}.npz"
        simulate = ["simulate", str(drive), "--steps", "120", "--landmarks", "400"]
        assert main([*simulate, "--seed", str(seed)]) == 0
        assert main(["solve", str(drive), "--out", str(folder / f"run{seed}"), "--smooth"]) == 0
    return folder


def evaluate(capsys: Any, *words: object) -> str:
    """What the command prints."""
    capsys.readouterr()
    assert main(["evaluate", *map(str, words)]) == 0
    return str(capsys.readouterr().out)


def table_rows(text: str) -> list[list[str]]:
    """Cells of the first table's rows."""
    lines = text.splitlines()
    rule = next(k for k, line in enumerate(lines) if "───" in line)
    end = next(k for k in range(rule, len(lines)) if not lines[k].strip())
    return [[cell for cell in line.split("  ") if cell.strip()] for line in lines[rule + 1 : end]]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_figures_of_three_runs_are_evos(
    seed: int, runs: Path, tmp_path: Path, capsys: Any
) -> None:
    reference = runs / f"{seed}.tum"
    errors = json.loads(evaluate(capsys, runs / f"run{seed}", "--reference", reference, "--json"))
    for name in ("trajectory", "smoothed", "dead_reckoning"):
        files = (reference, runs / f"run{seed}" / f"{name}.tum")
        for figure, command in (("ate_m", ["evo_ape", "--align"]), ("rpe_frame_m", ["evo_rpe"])):
            theirs = evo_statistics(tmp_path, command[0], *files, *command[1:])
            for statistic, value in errors[name][figure].items():
                assert value == pytest.approx(theirs[statistic], abs=1e-6), (name, figure)
                assert value == pytest.approx(theirs[statistic], rel=1e-6), (name, figure)


def test_filtered_smoothed_and_dead_reckoning_of_several_runs_are_rows_of_one_table(
    runs: Path, tmp_path: Path, capsys: Any
) -> None:
    shutil.copytree(runs / "run1", tmp_path / "again")
    (tmp_path / "again" / "smoothed.tum").unlink()
    reference = runs / "1.tum"
    paths = [runs / "run1", tmp_path / "again", reference]
    rows = table_rows(evaluate(capsys, *paths, "--reference", reference))
    assert [row[1].strip() for row in rows] == [
        *("filtered", "smoothed", "dead reckoning"),
        *("filtered", "dead reckoning"),
        "trajectory",
    ]
    listed = json.loads(evaluate(capsys, *paths, "--reference", reference, "--json"))
    assert [each["run"] for each in listed] == [str(path) for path in paths]
    assert "smoothed" not in listed[1]
    assert listed[2]["trajectory"]["ate_m"]["max"] < 1e-9
    errors = listed[0]["smoothed"]
    assert rows[1][2].split() == ["120"]
    assert [cell.strip() for cell in rows[1][3:6]] == [
        f"{errors['ate_m']['rmse']:.3f}",
        f"{errors['ate_m']['max']:.3f}",
        f"{errors['rpe_frame_m']['rmse']:.4f}",
    ]
    assert rows[1][-1].strip() == f"{100 * errors['nees_inside']:.0f} %"
    assert rows[2][-1].strip() == "-"


def test_one_run_is_one_object_with_all_its_figures(runs: Path, capsys: Any) -> None:
    reference = runs / "2.tum"
    errors = json.loads(evaluate(capsys, runs / "run2", "--reference", reference, "--json"))
    assert errors["trajectory"]["poses"] == 120
    assert errors["trajectory"]["ate_m"]["rmse"] < errors["dead_reckoning"]["ate_m"]["rmse"]
    lengths = [row["length_m"] for row in errors["trajectory"]["kitti_by_length"]]
    assert len(lengths) > 1
    text = evaluate(capsys, runs / "run2", "--reference", reference)
    assert all(f"{round(length, 1):g} m" in text for length in lengths)


def test_the_alignment_and_the_largest_difference_in_time_are_as_told(
    runs: Path, tmp_path: Path, capsys: Any
) -> None:
    truth = read_tum(runs / "1.tum")
    c, s = np.cos(0.5), np.sin(0.5)
    turned = Trajectory(
        truth.stamps + 30_000_000,
        truth.positions @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [7.0, 0.0, 0.0],
        truth.quaternions,
    )
    write_tum(tmp_path / "turned.tum", turned)
    words = (tmp_path / "turned.tum", "--reference", runs / "1.tum", "--max-difference", "0.035")
    errors = {
        align: json.loads(evaluate(capsys, *words, "--align", align, "--json"))["trajectory"]
        for align in ("se3", "yaw", "none")
    }
    assert errors["se3"]["ate_m"]["rmse"] < 1e-9
    assert errors["yaw"]["ate_m"]["rmse"] < 1e-9
    assert errors["none"]["ate_m"]["rmse"] > 5.0
    assert {each["poses"] for each in errors.values()} == {120}
    assert main(["evaluate", *map(str, words[:-1]), "0.025"]) == 1
    assert "0 poses of the reference lie within 0.025 s" in capsys.readouterr().err


def test_poses_without_a_covariance_are_told(runs: Path, tmp_path: Path, capsys: Any) -> None:
    reference = runs / "1.tum"
    halved = shutil.copytree(runs / "run1", tmp_path / "halved")
    table = halved / "trajectory_covariance.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:61]))
    assert main(["evaluate", str(runs / "run1"), "--reference", str(reference)]) == 0
    assert "covariance" not in capsys.readouterr().err
    assert main(["evaluate", str(halved), "--reference", str(reference)]) == 0
    assert "filtered: 60 of 120 poses have no covariance" in capsys.readouterr().err


def test_a_straight_line_is_said_to_be_one(tmp_path: Path, capsys: Any) -> None:
    stamps = 100_000_000 * np.arange(50)
    positions = np.linspace(0, 60, 50)[:, None] * [1.0, 0.5, 0.0]
    line = Trajectory(stamps, positions, np.tile([0.0, 0, 0, 1], (50, 1)))
    write_tum(tmp_path / "line.tum", line)
    words = [str(tmp_path / "line.tum"), "--reference", str(tmp_path / "line.tum")]
    assert main(["evaluate", *words]) == 0
    told = capsys.readouterr().err
    assert "the alignment is not unique: the path leaves a straight" in told
    assert "of turns about the vertical only one does: align by yaw" in told


def test_references_may_be_in_nanoseconds_or_eurocs(
    runs: Path, tmp_path: Path, capsys: Any
) -> None:
    truth = read_tum(runs / "3.tum")
    write_trajectory(tmp_path / "data.csv", truth, "euroc")
    lines = (runs / "3.tum").read_text().splitlines()
    (tmp_path / "ns.tum").write_text("".join(f"{line.replace('.', '', 1)}\n" for line in lines))
    tables = [
        evaluate(capsys, runs / "run3", "--reference", reference).split("\n", 1)[1]
        for reference in (runs / "3.tum", tmp_path / "data.csv", tmp_path / "ns.tum")
    ]
    assert tables[0] == tables[1] == tables[2]


def test_a_reference_in_nanoseconds_is_driven_along(tmp_path: Path) -> None:
    case = SHARED_CASES / "09_tum_in_nanoseconds" / "ns.tum"
    if not case.is_file():
        pytest.skip(f"needs {case}")
    drive = tmp_path / "drive.npz"
    words = ["--along", str(case), "--landmarks", "100"]
    assert main(["simulate", str(drive), *words]) == 0
    assert len(read_tum(drive.with_suffix(".tum"))) == 20
    assert main(["evaluate", str(drive.with_suffix(".tum")), "--reference", str(case)]) == 0


def test_the_length_is_that_of_the_part_that_is_compared(tmp_path: Path, capsys: Any) -> None:
    stamps = 100_000_000 * np.arange(101)
    positions = np.column_stack([np.arange(101.0), np.sin(np.arange(101.0) / 9), np.zeros(101)])
    whole = Trajectory(stamps, positions, np.tile([0.0, 0, 0, 1], (101, 1)))
    write_tum(tmp_path / "whole.tum", whole)
    words = ["--reference", tmp_path / "whole.tum"]
    for end, length in ((30, "30.1 m of its 100 m compared"), (98, "98"), (99, "100 m, not")):
        write_tum(tmp_path / "part.tum", whole.between(np.array([0, end])))
        first = evaluate(capsys, tmp_path / "part.tum", *words, "--align", "none").splitlines()[0]
        assert f"whole.tum, {length}" in first
    figures = json.loads(evaluate(capsys, tmp_path / "part.tum", *words, "--json"))
    compared = figures["trajectory"]["compared_m"]
    assert 0.99 * figures["reference_length_m"] < compared < figures["reference_length_m"]


def test_verify_and_evaluate_say_that_there_are_more_passes(
    runs: Path, tmp_path: Path, capsys: Any
) -> None:
    looped = shutil.copytree(runs / "run1", tmp_path / "looped")
    reference = ("--reference", str(runs / "1.tum"))
    note = f"note: {looped}: the first of 2 passes; the rest is in pass_002"
    for command in (["verify", str(looped)], ["evaluate", str(looped), *reference]):
        capsys.readouterr()
        assert main(command) == 0
        assert note not in capsys.readouterr().err
        shutil.copytree(runs / "run2", looped / "pass_002")
        assert main(command) == 0
        assert note in capsys.readouterr().err.splitlines()
        shutil.rmtree(looped / "pass_002")
