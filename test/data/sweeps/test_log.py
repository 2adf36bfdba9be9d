# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vislam_ros.data.drive import Drive
from vislam_ros.data.sweeps.log import SweepLog, identity_of
from vislam_ros.data.sweeps.run import SweepInputs
from vislam_ros.errors import VislamError

IDENTITY = {"drive": "one", "sha256": "1"}
ROW = {"key": "a", "ate_m": 0.1, "error": None}


def test_rows_are_there_for_the_next_call_and_the_last_one_counts(tmp_path: Path) -> None:
    with SweepLog(tmp_path / "sweep", IDENTITY) as log:
        log.append(ROW)
        log.append({**ROW, "key": "b"})
        log.append({**ROW, "ate_m": 0.2})
    with SweepLog(tmp_path / "sweep", IDENTITY) as log:
        assert log.rows == {"a": {**ROW, "ate_m": 0.2}, "b": {**ROW, "key": "b"}}


def test_a_line_that_a_kill_cut_short_is_dropped(tmp_path: Path) -> None:
    with SweepLog(tmp_path, IDENTITY) as log:
        log.append(ROW)
        log.append({**ROW, "key": "b"})
    runs = tmp_path / "runs.jsonl"
    runs.write_bytes(runs.read_bytes()[:-5])
    with SweepLog(tmp_path, IDENTITY) as log:
        assert list(log.rows) == ["a"]
        log.append({**ROW, "key": "c"})
    with SweepLog(tmp_path, IDENTITY) as log:
        assert list(log.rows) == ["a", "c"]


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    with SweepLog(tmp_path, IDENTITY) as log:
        log.append(ROW)
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write("[1]\n")
    with pytest.raises(VislamError, match="line 2: not the row of a run"):
        SweepLog(tmp_path, IDENTITY)


def test_another_sweep_is_refused_and_with_force_replaced(tmp_path: Path) -> None:
    with SweepLog(tmp_path, IDENTITY) as log:
        log.append(ROW)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(VislamError, match="another drive"):
        SweepLog(tmp_path, {**IDENTITY, "sha256": "2"})
    with SweepLog(tmp_path, {**IDENTITY, "sha256": "2"}, force=True) as log:
        assert not log.rows
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_directory_of_other_things_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(VislamError, match="holds no sweep"):
        SweepLog(tmp_path, IDENTITY)
    assert not (tmp_path / "runs.jsonl").exists()


def test_two_sweeps_never_write_to_one_directory(tmp_path: Path) -> None:
    with (
        SweepLog(tmp_path, IDENTITY),
        pytest.raises(VislamError, match="another sweep is writing"),
    ):
        SweepLog(tmp_path, IDENTITY, force=True)
    with SweepLog(tmp_path, IDENTITY):
        pass


def test_a_drive_is_known_by_its_content_and_not_by_its_name(small_drive: Drive) -> None:
    here = identity_of(SweepInputs(small_drive))["sha256"]
    renamed = dataclasses.replace(small_drive, name="other", notes=())
    moved = dataclasses.replace(small_drive, pixels=small_drive.pixels + np.float32(1))
    assert identity_of(SweepInputs(renamed))["sha256"] == here
    assert identity_of(SweepInputs(moved))["sha256"] != here
    assert identity_of(SweepInputs(small_drive, small_drive.ground_truth))["sha256"] != here
