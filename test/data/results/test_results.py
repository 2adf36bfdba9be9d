# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result directory: what is written reads back, whatever happens to the writer."""

import json
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from step_rows import step_row

from vislam_ros.core.geometry import se3
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import KINDS
from vislam_ros.data.pictures.results import plot_results
from vislam_ros.data.results.file_names import OWNED_FILES
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.results.writer import (
    COVARIANCE_COLUMNS,
    ResultWriter,
    note_on_passes,
    pass_directory,
)
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

STEPS = 30
PARAMETERS = {"slam_node": {"estimator": "joint", "seed": 7}}


class Run:
    """A seeded run: what a filter could have given."""

    def __init__(self) -> None:
        rng = np.random.default_rng(3)
        stamps = 1_300_000_000_123_456_789 + 100_000_000 * np.arange(STEPS)
        self.trajectory = Trajectory.from_matrices(stamps, se3.exp(rng.normal(size=(STEPS, 6))))
        A = rng.normal(size=(STEPS, 6, 6))
        self.covariances = A @ np.swapaxes(A, 1, 2)
        self.covariances = 0.5 * (self.covariances + np.swapaxes(self.covariances, 1, 2))
        self.steps = [
            step_row(
                int(stamp), frozen=k % 7 == 0, landmarks=5 * k, nis=rng.chisquare(90), ms=1 / 3
            )
            for k, stamp in enumerate(stamps)
        ]
        self.landmarks = LandmarkMap(
            ids=np.array([4, 4, 9], dtype=np.uint32),
            generations=np.array([0, 1, 0], dtype=np.uint32),
            positions=rng.normal(size=(3, 3)),
            covariances=np.tile(np.eye(3), (3, 1, 1)),
        )

    def write(self, writer: ResultWriter) -> None:
        writer.set_parameters(PARAMETERS)
        poses = self.trajectory
        for k, row in enumerate(self.steps):
            pose = poses.positions[k], poses.quaternions[k]
            writer.add_step(*pose, self.covariances[k], row)
            writer.add_dead_reckoning(int(poses.stamps[k]), *pose)
        writer.set_landmarks(self.landmarks)


@pytest.fixture(scope="module")
def run() -> Run:
    return Run()


def assert_same_trajectory(actual: Trajectory | None, expected: Trajectory) -> None:
    assert actual is not None
    np.testing.assert_array_equal(actual.stamps, expected.stamps)
    np.testing.assert_array_equal(actual.positions, expected.positions)
    np.testing.assert_array_equal(actual.quaternions, expected.quaternions)


def test_everything_reads_back_to_the_last_bit(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "deep" / "results") as writer:
        run.write(writer)
        writer.set_smoothed(run.trajectory, 0.5 * run.covariances)
        writer.summary.drive = "0027"
        writer.summary.refused = {"late": 2}
        writer.finish(complete=True)

    results = read_results(tmp_path / "deep" / "results")
    for trajectory in (results.trajectory, results.dead_reckoning, results.smoothed):
        assert_same_trajectory(trajectory, run.trajectory)
    np.testing.assert_array_equal(results.covariances, run.covariances)
    np.testing.assert_array_equal(results.smoothed_covariances, 0.5 * run.covariances)
    assert list(results.steps) == list(run.steps[0])
    for name, column in results.steps.items():
        assert column.tolist() == [row[name] for row in run.steps], name
        assert type(column.tolist()[0]) is KINDS.get(name, float), name
    assert results.landmarks is not None
    np.testing.assert_array_equal(results.landmarks.positions, run.landmarks.positions)
    assert results.parameters == PARAMETERS
    assert results.name == "0027"
    summary = results.summary
    assert (summary["complete"], summary["incomplete_reason"]) == (True, None)
    assert (summary["estimator"], summary["steps"]) == ("joint", STEPS)
    assert (summary["landmarks"], summary["tracks"]) == (3, 2)
    assert summary["refused"] == {"late": 2}
    assert summary["gyro_bias"] == [0.01, 0.02, 0.03]
    assert summary["estimates"]["gyro_bias_std_y"] == 0.001
    assert {path.name for path in results.directory.iterdir()} <= set(OWNED_FILES)


def test_a_directory_of_an_earlier_version_is_read_and_drawn(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        run.write(writer)
    table = writer.directory / "steps.csv"
    rows = [line.split(",")[:11] for line in table.read_text().splitlines()]
    table.write_text("".join(f"{','.join(row)}\n" for row in rows))
    summary = json.loads((writer.directory / "summary.json").read_text())
    del summary["estimates"]
    (writer.directory / "summary.json").write_text(json.dumps(summary))
    results = read_results(writer.directory)
    assert list(results.steps) == list(run.steps[0])[:11]
    assert len(plot_results(results)) == 2


def test_what_an_estimator_of_somebody_s_own_tells_reads_back(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        for k, row in enumerate(run.steps):
            pose = run.trajectory.positions[k], run.trajectory.quaternions[k]
            writer.add_step(*pose, np.eye(6), {**row, "wheel_scale": 1 + k / 3})
        with pytest.raises(
            ValueError, match=r"steps.csv: the columns are no longer stamp, frozen"
        ):
            writer.add_step(*pose, np.eye(6), {**row, "stamp": row["stamp"] + 1})
    results = read_results(tmp_path / "results")
    assert results.steps["wheel_scale"].tolist() == [1 + k / 3 for k in range(STEPS)]
    assert results.summary["estimates"]["wheel_scale"] == 1 + (STEPS - 1) / 3


def test_rows_are_on_disk_at_once_and_the_rest_after_a_flush(run: Run, tmp_path: Path) -> None:
    writer = ResultWriter(tmp_path / "results")
    run.write(writer)
    assert len(read_results(writer.directory).trajectory) == STEPS
    writer.flush()
    results = read_results(writer.directory)
    assert results.landmarks is not None
    assert results.summary["steps"] == STEPS
    assert results.summary["complete"] is False
    writer.finish(complete=False, incomplete_reason="3 features messages had no answer")
    assert read_results(writer.directory).summary["incomplete_reason"].startswith("3 features")


def test_a_run_that_breaks_off_says_so(run: Run, tmp_path: Path) -> None:
    with suppress(KeyboardInterrupt), ResultWriter(tmp_path / "a") as writer:
        run.write(writer)
        raise KeyboardInterrupt
    summary = read_results(tmp_path / "a").summary
    assert (summary["complete"], summary["incomplete_reason"]) == (False, "KeyboardInterrupt")
    with ResultWriter(tmp_path / "b") as writer:
        run.write(writer)
    assert read_results(tmp_path / "b").summary["complete"] is False


def test_time_never_goes_back_in_a_directory(run: Run, tmp_path: Path) -> None:
    pose = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    with ResultWriter(tmp_path / "results") as writer:
        writer.add_dead_reckoning(5, *pose)
        writer.add_step(*pose, np.eye(6), step_row(5))
        with pytest.raises(ValueError, match=r"trajectory.tum: stamp 5 is not later than 5"):
            writer.add_step(*pose, np.eye(6), step_row(5))
        with pytest.raises(ValueError, match=r"dead_reckoning.tum: stamp 4"):
            writer.add_dead_reckoning(4, *pose)


def test_a_directory_in_use_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(VislamError, match=r"is not empty.*--force"):
        ResultWriter(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(VislamError, match=r"notes.txt: cannot be a result directory"):
        ResultWriter(tmp_path / "notes.txt")


def test_force_replaces_the_old_run_and_nothing_else(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path) as writer:
        run.write(writer)
        writer.finish(complete=True)
    with ResultWriter(tmp_path / "pass_002") as writer:
        run.write(writer)
        writer.finish(complete=True)
    for folder in (tmp_path, tmp_path / "pass_002"):
        (folder / "notes.txt").write_text("mine")
    ResultWriter(tmp_path, force=True).finish(complete=False, incomplete_reason="nothing yet")
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*")) == [
        "notes.txt",
        "pass_002/notes.txt",
        "summary.json",
    ]


ENDLESS = """
import sys
from pathlib import Path
import numpy as np
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import KINDS
from vislam_ros.data.results.writer import ResultWriter

pose = ([1 / 3, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0])
with ResultWriter(Path(sys.argv[1])) as writer:
    writer.set_parameters({"slam_node": {"estimator": "joint"}})
    stamp = 10**18
    while True:
        stamp += 10**8
        row = {**dict.fromkeys(KINDS, 1), "stamp": stamp}
        writer.add_step(*pose, np.eye(6) / 3, row)
        writer.add_dead_reckoning(stamp, *pose)
        size = stamp // 10**8 % 5000
        writer.set_landmarks(
            LandmarkMap(
                np.arange(size, dtype=np.uint32),
                np.zeros(size, dtype=np.uint32),
                np.ones((size, 3)),
                np.tile(np.eye(3), (size, 1, 1)),
            )
        )
"""


def steps_in_summary(directory: Path) -> int:
    try:
        return int(json.loads((directory / "summary.json").read_text())["steps"])
    except FileNotFoundError:
        return 0


@pytest.mark.timeout(120)
def test_a_killed_run_is_readable_up_to_its_last_moment(tmp_path: Path) -> None:
    directory = tmp_path / "results"
    child = subprocess.Popen([sys.executable, "-c", ENDLESS, str(directory)])
    try:
        deadline = time.monotonic() + 90
        while steps_in_summary(directory) == 0:
            assert child.poll() is None, "the writer ended by itself"
            assert time.monotonic() < deadline, "the summary was never brought up to date"
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait(30)

    results = read_results(directory)
    assert results.summary["complete"] is False
    assert results.landmarks is not None
    assert results.parameters == {"slam_node": {"estimator": "joint"}}
    assert results.dead_reckoning is not None
    # The rows of the four files are written one after the other: at most one is missing.
    counts = {len(results.trajectory), len(results.dead_reckoning), len(results.steps["stamp"])}
    assert max(counts) - min(counts) <= 1
    assert min(counts) >= results.summary["steps"] - 1
    assert np.all(results.covariances[:-1] == np.eye(6) / 3)


@pytest.mark.parametrize(
    "name", ["trajectory.tum", "dead_reckoning.tum", "trajectory_covariance.csv", "steps.csv"]
)
def test_a_last_line_cut_anywhere_costs_that_line_only(
    run: Run, tmp_path: Path, name: str
) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        run.write(writer)
    path = writer.directory / name
    whole = path.read_bytes()
    last_line = len(whole.splitlines(keepends=True)[-1])
    for cut in (1, 2, 5, last_line // 2, last_line - 1, last_line):
        path.write_bytes(whole[:-cut])
        results = read_results(writer.directory)
        assert results.dead_reckoning is not None
        counts = {
            "trajectory.tum": len(results.trajectory),
            "dead_reckoning.tum": len(results.dead_reckoning),
            "trajectory_covariance.csv": int(np.isfinite(results.covariances[:, 0, 0]).sum()),
            "steps.csv": len(results.steps["stamp"]),
        }
        expected = dict.fromkeys(counts, STEPS)
        expected["trajectory_covariance.csv"] = counts["trajectory.tum"]
        expected[name] = STEPS - 1
        assert counts == expected


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (("summary.json", None), r"summary.json: cannot read this summary: No such file"),
        (("trajectory.tum", None), r"trajectory.tum: holds no pose"),
        (("trajectory.tum", ""), r"trajectory.tum: holds no pose"),
        (("trajectory.tum", "1.0 2\n"), r"trajectory.tum: line 1"),
        (("steps.csv", "a,b\n"), r"steps.csv: line 1 must begin with stamp,frozen"),
        (("trajectory_covariance.csv", "x_x\n"), r"line 1 must begin with stamp,x_x"),
        (
            ("trajectory_covariance.csv", f"{','.join(COVARIANCE_COLUMNS)}\ninf{',0' * 21}\n"),
            r"line 2 is 'inf,0.*: it must hold 22 numbers, the first a finite time in seconds",
        ),
    ],
)
def test_what_is_missing_or_damaged_is_named(
    run: Run, tmp_path: Path, damage: tuple[str, str | None], message: str
) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        run.write(writer)
    name, content = damage
    (writer.directory / name).unlink()
    if content is not None:
        (writer.directory / name).write_text(content)
    with pytest.raises(VislamError, match=message):
        read_results(writer.directory)


def test_a_damaged_row_is_named(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        run.write(writer)
    with (writer.directory / "steps.csv").open("a") as file:
        file.write("1.0,0,x" + 16 * ",0" + "\n")
    with pytest.raises(VislamError, match=rf"steps.csv: line {STEPS + 2} is '1.0,0,x"):
        read_results(writer.directory)


def test_a_missing_directory_is_named(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="none: no such result directory"):
        read_results(tmp_path / "none")


@pytest.mark.parametrize("there_before", [False, True])
def test_a_run_that_fails_leaves_nothing_of_its_own(
    run: Run, tmp_path: Path, there_before: bool
) -> None:
    directory = tmp_path / "deep" / "results"
    if there_before:
        directory.mkdir(parents=True)
        (directory / "notes.txt").write_text("mine")
    with suppress(RuntimeError), ResultWriter(directory, force=True) as writer:
        run.write(writer)
        raise RuntimeError("no memory")
    left = sorted(path.name for path in tmp_path.rglob("*"))
    assert left == (["deep", "notes.txt", "results"] if there_before else [])


def test_a_full_disk_is_a_known_error(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("needs /dev/full, which stands for a full disk")
    with ResultWriter(tmp_path / "results") as writer:
        (tmp_path / "results" / "dead_reckoning.tum").symlink_to(full)
        with pytest.raises(VislamError, match=r"dead_reckoning.tum: cannot write.*No space"):
            writer.add_dead_reckoning(1, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])


def test_results_that_were_not_smoothed_say_so(run: Run, tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        run.write(writer)
    results = read_results(tmp_path / "results")
    assert results.smoothed is None
    assert results.smoothed_covariances is None


@pytest.mark.parametrize(
    ("passes", "note"),
    [
        (1, None),
        (2, "the first of 2 passes; the rest is in pass_002"),
        (4, "the first of 4 passes; the rest is in pass_002 to pass_004"),
    ],
)
def test_a_note_says_that_there_are_more_passes(tmp_path, passes, note):
    for number in range(1, passes + 1):
        with ResultWriter(pass_directory(tmp_path, number)):
            pass
    pass_directory(tmp_path, passes + 1).mkdir()  # as an earlier run with more of them leaves it
    assert note_on_passes(tmp_path) == (note and f"{tmp_path}: {note}")
