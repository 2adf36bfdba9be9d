# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
from step_rows import step_row

from vislam_ros.data.results.growing import GrowingResults
from vislam_ros.data.results.writer import ResultWriter

SECOND = 10**9
TURNED = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]


def test_each_step_is_told_once_as_it_was_written(tmp_path: Path) -> None:
    growing = GrowingResults(tmp_path / "results")
    assert growing.new_steps() == []
    covariance = np.cov(np.random.default_rng(3).normal(size=(6, 20)))
    stamps = (SECOND + 123_456_789 * np.arange(1, 8)).tolist()
    with ResultWriter(tmp_path / "results") as writer:
        for part in (stamps[:2], stamps[2:2], stamps[2:3], stamps[3:]):
            for stamp in part:
                writer.add_step([1.5, -2.0, 3e-9], TURNED, covariance, step_row(stamp))
            steps = growing.new_steps()
            assert [step.stamp for step in steps] == part
            for step in steps:
                np.testing.assert_array_equal(step.covariance, covariance)
                np.testing.assert_array_equal(step.quaternion, TURNED)
                np.testing.assert_array_equal(step.position, [1.5, -2.0, 3e-9])
                expected = {name: float(value) for name, value in step_row(0).items()}
                assert {"stamp": 0.0, **step.row} == expected
        writer.finish(complete=True)
    assert growing.new_steps() == []


def test_a_row_that_is_half_written_is_told_when_it_is_whole(tmp_path: Path) -> None:
    with ResultWriter(tmp_path) as writer:
        for stamp in (SECOND, 2 * SECOND):
            writer.add_step([0.0] * 3, TURNED, np.eye(6), step_row(stamp))
        writer.finish(complete=True)
    steps = tmp_path / "steps.csv"
    whole = steps.read_bytes()
    steps.write_bytes(whole[:-5])
    growing = GrowingResults(tmp_path)
    assert [step.stamp for step in growing.new_steps()] == [SECOND]
    steps.write_bytes(whole)
    assert [step.stamp for step in growing.new_steps()] == [2 * SECOND]


def test_what_is_no_row_is_left_out(tmp_path: Path) -> None:
    with ResultWriter(tmp_path) as writer:
        for stamp in (SECOND, 2 * SECOND, 3 * SECOND):
            writer.add_step([0.0] * 3, TURNED, np.eye(6), step_row(stamp))
        writer.finish(complete=True)
    path = tmp_path / "trajectory.tum"
    first, second, third = path.read_text().splitlines()
    path.write_text(f"{first}\n{second.replace('0.0', 'nothing', 1)}\n\n{third}\n")
    stamps = [step.stamp for step in GrowingResults(tmp_path).new_steps()]
    assert stamps == [SECOND, 3 * SECOND]
