# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands that need no graph: what they write, print and refuse."""

import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import REPOSITORY

from vislam_ros.cli.main import main
from vislam_ros.cli.screen import print_summary
from vislam_ros.data.pictures.results import plot_results
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.trajectory import read_tum


@pytest.fixture(scope="session")
def solved(tmp_path_factory, dataset):
    """Results of the small drive."""
    path = tmp_path_factory.mktemp("solved") / "results"
    assert main(["solve", str(dataset), "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="session")
def smoothed(tmp_path_factory, dataset):
    """The same, smoothed."""
    path = tmp_path_factory.mktemp("smoothed") / "results"
    assert main(["solve", str(dataset), "--out", str(path), "--smooth"]) == 0
    return path


def error_line(capsys, *argv):
    """The one line that a command fails with."""
    assert main([str(word) for word in argv]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    return lines[0]


def test_equal_seeds_simulate_equal_files(tmp_path):
    paths = [tmp_path / "one.npz", tmp_path / "two.npz", tmp_path / "three.npz"]
    for path, seed in zip(paths, ("4", "4", "5"), strict=True):
        argv = ["simulate", path, "--steps", "20", "--landmarks", "60", "--seed", seed]
        assert main([str(word) for word in argv]) == 0
    one, two, three = (path.read_bytes() for path in paths)
    assert one == two != three
    assert len(read_tum(tmp_path / "one.tum")) == 20


def test_a_drive_is_simulated_along_a_reference_to_its_end(tmp_path, capsys):
    first, again = tmp_path / "first.npz", tmp_path / "again.npz"
    simulate = ["simulate", "--landmarks", "60", "--steps", "20"]
    assert main([*simulate, str(first)]) == 0
    along = ["--along", str(tmp_path / "first.tum")]
    assert main(["simulate", "--landmarks", "60", "--seed", "3", *along, str(again)]) == 0
    one, other = (read_tum(path.with_suffix(".tum")) for path in (first, again))
    np.testing.assert_array_equal(one.stamps, other.stamps)
    np.testing.assert_allclose(one.T_world_body, other.T_world_body, atol=1e-12)
    capsys.readouterr()
    line = error_line(capsys, "simulate", tmp_path / "x.npz", "--steps", "21", *along)
    assert "21 steps" in line


def test_a_bag_that_solve_cannot_read_is_not_whole(bag, tmp_path, capsys):
    foreign = tmp_path / "foreign.mcap"
    shutil.copy(next(bag.glob("*.mcap")), foreign)
    assert main(["verify", str(foreign)]) == 0
    params = tmp_path / "params.yaml"
    params.write_text("'/**': {ros__parameters: {base_frame: car}}\n")
    capsys.readouterr()
    for command in (["solve", foreign, "--out", tmp_path / "out"], ["verify", foreign]):
        assert main([str(word) for word in [*command, "--params", params]]) == 1
        line = capsys.readouterr().err.splitlines()[-1]
        assert "no usable message on /stereo/extrinsics and /imu/twist" in line
    assert "is not damaged, but solve cannot read it: " in line


def test_the_bag_is_whole_and_a_flipped_bit_is_found(bag, tmp_path, capsys):
    assert main(["verify", str(bag)]) == 0
    damaged = tmp_path / "damaged"
    shutil.copytree(bag, damaged)
    storage = next(damaged.glob("*.mcap*"))
    content = bytearray(storage.read_bytes())
    content[len(content) // 2] ^= 1
    storage.write_bytes(content)
    capsys.readouterr()
    assert storage.name in error_line(capsys, "verify", damaged)
    assert "damaged" in error_line(capsys, "solve", damaged, "--out", tmp_path / "results")
    assert "damaged" in error_line(capsys, "play", damaged)
    assert "damaged" in error_line(capsys, "run", damaged, "--out", tmp_path / "results")
    assert not (tmp_path / "results").exists()


def test_a_dataset_and_its_bag_are_solved_alike(solved, bag, tmp_path, capsys):
    assert main(["solve", str(bag), "--out", str(tmp_path / "results")]) == 0
    assert "complete" in capsys.readouterr().out
    for name in ("trajectory.tum", "dead_reckoning.tum", "landmarks.ply", "params.yaml"):
        assert (tmp_path / "results" / name).read_bytes() == (solved / name).read_bytes(), name


def test_smoothing_adds_smoothed_poses_and_the_exact_map_and_changes_no_filtered_pose(
    solved, smoothed
):
    for name in ("trajectory.tum", "trajectory_covariance.csv", "params.yaml"):
        assert (smoothed / name).read_bytes() == (solved / name).read_bytes(), name
    filtered, results = read_results(solved), read_results(smoothed)
    assert filtered.smoothed is None
    assert results.smoothed.stamps.tolist() == results.trajectory.stamps.tolist()
    header = (smoothed / "smoothed_covariance.csv").read_text().splitlines()[0]
    assert header == (smoothed / "trajectory_covariance.csv").read_text().splitlines()[0]
    # Looking back knows more of all but the last pose, where there is nothing to look back from.
    lost = [
        np.trace(before - after)
        for before, after in zip(results.covariances, results.smoothed_covariances, strict=True)
    ]
    assert min(lost) > -1e-9
    assert lost[len(lost) // 2] > 1e-6
    # But for the spread between bias and none, which lies in one direction.
    spread = np.linalg.eigvalsh(results.covariances[-1] - results.smoothed_covariances[-1])
    np.testing.assert_allclose(spread[:-1], 0.0, rtol=0, atol=1e-9)
    assert spread[-1] < 0.01 * np.trace(results.covariances[-1])
    assert results.landmarks.ids.tolist() == filtered.landmarks.ids.tolist()
    assert np.any(results.landmarks.positions != filtered.landmarks.positions)
    assert main(["verify", str(smoothed)]) == 0


def test_smoothed_poses_are_evaluated_and_drawn(smoothed, dataset, tmp_path, capsys):
    reference = str(dataset.with_suffix(".tum"))
    assert main(["evaluate", str(smoothed), "--reference", reference]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[:2] for row in rows if row[-1:] == ["%"]] == [
        ["filtered", "60"],
        ["smoothed", "60"],
    ]
    assert main(["evaluate", str(smoothed), "--reference", reference, "--json"]) == 0
    errors = json.loads(capsys.readouterr().out)["smoothed"]
    assert errors["ate_m"]["rmse"] < 5.0
    assert errors["nees_poses"] > 0
    assert main(["plot", str(smoothed), "--output", str(tmp_path)]) == 0
    assert (tmp_path / "trajectory.png").exists()


def test_what_is_estimated_is_in_the_summary_and_on_the_screen_where_it_is(
    solved, dataset, tmp_path, capsys
):
    summary = read_results(solved).summary
    assert len(summary["gyro_bias"]) == 3
    print_summary("results", summary)
    assert f"{summary['gyro_bias'][0]:.3g} ± " in capsys.readouterr().out
    argv = ["solve", dataset, "--out", tmp_path / "results", "--estimator", "dead_reckoning"]
    assert main([str(word) for word in argv]) == 0
    assert read_results(tmp_path / "results").summary["gyro_bias"] is None
    assert "gyro bias" not in capsys.readouterr().out


def test_an_estimator_that_cannot_be_smoothed_is_refused_before_anything_is_written(
    dataset, tmp_path, capsys
):
    argv = ("solve", dataset, "--smooth", "--estimator", "mapping", "--out", tmp_path / "results")
    line = error_line(capsys, *argv)
    assert line == "error: estimator: 'mapping' cannot be smoothed; use robocentric or joint"
    assert not (tmp_path / "results").exists()


def test_solved_results_are_whole_until_something_is_missing(solved, tmp_path, capsys):
    assert main(["verify", str(solved)]) == 0
    broken = tmp_path / "broken"
    shutil.copytree(solved, broken)
    lines = (broken / "trajectory.tum").read_text().splitlines(keepends=True)
    (broken / "trajectory.tum").write_text("".join(lines[:-1]))
    capsys.readouterr()
    assert main(["verify", str(broken)]) == 1
    assert "trajectory.tum holds 59 poses, summary.json says 60" in capsys.readouterr().err


def test_an_interrupted_run_is_told_apart(solved, tmp_path, capsys):
    broken = tmp_path / "broken"
    shutil.copytree(solved, broken)
    summary = json.loads((broken / "summary.json").read_text())
    summary.update(complete=False, incomplete_reason="the power went")
    (broken / "summary.json").write_text(json.dumps(summary))
    assert "incomplete: the power went" in error_line(capsys, "verify", broken)


def test_overrides_win_over_the_parameter_file(dataset, tmp_path, capsys):
    params = tmp_path / "params.yaml"
    params.write_text(
        "/**: {ros__parameters: {use_sim_time: true, somebody_elses: 1}}\n"
        "slam_node: {ros__parameters: {estimator: mapping, chi2_gate: 11.0, seed: 3}}\n"
    )
    out = tmp_path / "results"
    argv = ["solve", dataset, "--out", out, "--params", params]
    argv += ["--estimator", "dead_reckoning", "--fraction", "0.5"]
    assert main([str(word) for word in argv]) == 0
    used = read_results(out).parameters["slam_node"]
    assert used["estimator"] == "dead_reckoning"
    assert (used["seed"], used["feature_fraction"]) == (3, 0.5)
    assert "chi2_gate" not in used
    told = "warning: slam_node: chi2_gate: set, but not used by estimator dead_reckoning"
    assert told in capsys.readouterr().err.splitlines()
    assert read_results(out).summary["complete"] is True


def test_localization_takes_the_map_of_another_run(solved, dataset, tmp_path, capsys):
    out = tmp_path / "results"
    argv = ["solve", dataset, "--out", out, "--estimator", "localization"]
    assert "map" in error_line(capsys, *argv)
    argv += ["--force", "--map", solved / "landmarks.npz"]
    assert main([str(word) for word in argv]) == 0
    assert json.loads((out / "summary.json").read_text())["estimator"] == "localization"


def test_results_of_an_earlier_version_are_verified_evaluated_and_drawn(solved, dataset, tmp_path):
    older = shutil.copytree(solved, tmp_path / "older")
    rows = [line.split(",")[:11] for line in (older / "steps.csv").read_text().splitlines()]
    (older / "steps.csv").write_text("".join(f"{','.join(row)}\n" for row in rows))
    summary = json.loads((older / "summary.json").read_text())
    del summary["estimates"]
    (older / "summary.json").write_text(json.dumps(summary))
    assert main(["verify", str(older)]) == 0
    assert main(["evaluate", str(older), "--reference", str(dataset.with_suffix(".tum"))]) == 0
    assert main(["plot", str(older)]) == 0


def test_pictures_are_drawn_and_not_replaced_unasked(solved, dataset, tmp_path, capsys):
    reference = dataset.with_suffix(".tum")
    argv = ["plot", solved, "--reference", reference, "--output", tmp_path / "pictures"]
    assert main([str(word) for word in argv]) == 0
    for picture in capsys.readouterr().out.split():
        assert Path(picture).read_bytes().startswith(b"\x89PNG")
    assert "exists already" in error_line(capsys, *argv)
    assert main([str(word) for word in [*argv, "--force"]]) == 0


def test_a_picture_that_nobody_asked_for_is_replaced_and_one_that_somebody_did_is_not(
    solved, tmp_path, capsys
):
    results = read_results(solved)
    plot_results(results, output=tmp_path, of_run=True)
    drawn = (tmp_path / "trajectory.png").read_bytes()
    argv = ["plot", solved, "--output", tmp_path]
    assert main([str(word) for word in argv]) == 0
    assert (tmp_path / "trajectory.png").read_bytes() != drawn
    assert "exists already" in error_line(capsys, *argv)
    (tmp_path / "trajectory.png").write_bytes(b"mine")
    (tmp_path / "steps.png").write_bytes(drawn)
    assert "trajectory.png: exists already" in error_line(capsys, *argv)
    assert (tmp_path / "steps.png").read_bytes() == drawn


def test_each_command_tells_the_next_in_words_that_can_be_pasted(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    argv = ["simulate", "a drive.npz", "--steps", "40", "--landmarks", "200"]
    assert main(argv) == 0
    told = next_command(capsys)
    assert told == ["run", "a drive.npz", "--out", "results/a drive"]
    assert main(["solve", *told[1:]]) == 0
    wrote, _ = capsys.readouterr().err.splitlines()[-2:]
    assert "wrote results/a drive: " in wrote
    names = {path.name for path in Path("results/a drive").iterdir()}
    assert set(wrote.split(": ")[1].split(", ")) == names
    assert main(["verify", "results/a drive"]) == 0
    told = next_command(capsys)
    assert told == ["evaluate", "results/a drive", "--reference", "REF.tum"]
    assert main([*told[:-1], "a drive.tum"]) == 0
    told = next_command(capsys)
    assert told == ["plot", "results/a drive", "--reference", "a drive.tum"]
    assert main(told) == 0
    assert main(["convert", "a drive.npz", "bag"]) == 0
    assert next_command(capsys) == ["run", "bag", "--out", "results/a drive"]
    assert main(["verify", "bag"]) == 0
    assert next_command(capsys) == ["solve", "bag", "--out", "results/bag"]


def next_command(capsys):
    """Words after vislam that the last line of standard error tells."""
    line = capsys.readouterr().err.splitlines()[-1]
    words = shlex.split(line)
    assert words[:2] == ["next:", "vislam"], line
    return words[2:]


def test_an_output_that_exists_is_refused_and_left_alone(solved, dataset, bag, capsys):
    before = {path: path.read_bytes() for path in solved.iterdir() if path.is_file()}
    for argv in (
        ("simulate", dataset),
        ("convert", dataset, bag),
        ("solve", dataset, "--out", solved),
        ("run", dataset, "--out", solved),
    ):
        line = error_line(capsys, *argv)
        assert "--force" in line
    assert {path: path.read_bytes() for path in solved.iterdir() if path.is_file()} == before


def test_a_missing_input_spoils_no_results(solved, tmp_path, capsys):
    copy = tmp_path / "results"
    shutil.copytree(solved, copy)
    for command in ("solve", "run"):
        argv = (command, tmp_path / "none.npz", "--out", copy, "--force")
        assert "none.npz" in error_line(capsys, *argv)
    assert main(["verify", str(copy)]) == 0


@pytest.mark.parametrize(
    "argv",
    [
        ("convert", "none.npz", "bag"),
        ("play", "none"),
        ("evaluate", "none", "--reference", "none.tum"),
        ("plot", "none"),
        ("verify", "none"),
        ("solve", "none.npz", "--out", "r", "--params", "none.yaml"),
    ],
)
def test_a_missing_file_is_one_line_that_names_it(argv, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "none" in error_line(capsys, *argv)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ("chi2_gate: -1.0", ("slam_node", "chi2_gate", "-1.0")),
        ("estimater: joint", ("slam_node", "estimater", "estimator")),
        ("seed: often", ("slam_node", "seed", "often")),
    ],
)
@pytest.mark.parametrize("command", ["solve", "run"])
def test_a_bad_parameter_is_named_before_anything_is_done(
    command, parameters, words, dataset, tmp_path, capsys
):
    params = tmp_path / "params.yaml"
    params.write_text(f"slam_node: {{ros__parameters: {{{parameters}}}}}\n")
    line = error_line(capsys, command, dataset, "--out", tmp_path / "r", "--params", params)
    for word in words:
        assert word in line
    assert not (tmp_path / "r").exists()


def test_verbose_shows_where_an_error_is_from(capsys):
    assert main(["verify", "none", "-v"]) == 1
    text = capsys.readouterr().err
    assert text.startswith("Traceback")
    assert text.splitlines()[-1].startswith("error: none: ")


def test_ctrl_c_while_solving_keeps_what_there_is(dataset, tmp_path, monkeypatch, capsys):
    from vislam_ros.core.slam import Slam

    add_features, count = Slam.add_features, 0

    def interrupted_add(self, *frame):
        nonlocal count
        count += 1
        if count == 30:
            raise KeyboardInterrupt
        return add_features(self, *frame)

    monkeypatch.setattr(Slam, "add_features", interrupted_add)
    out = tmp_path / "results"
    assert main(["solve", str(dataset), "--out", str(out)]) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "interrupted"
    results = read_results(out)
    assert len(results.trajectory) == 29
    assert results.summary["complete"] is False


@pytest.mark.parametrize(
    ("tool", "command"), [("play_bag.py", "play"), ("convert_dataset.py", "convert")]
)
def test_tools_are_the_commands(tool, command):
    result = subprocess.run(
        [sys.executable, REPOSITORY / "tools" / tool, "--help"],
        cwd=REPOSITORY.parent,
        env={"PATH": "", "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert result.stdout.startswith(f"usage: vislam {command}")
