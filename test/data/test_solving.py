# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What solve gives: trajectories with covariances, a table of steps, the numbers of a summary."""

import dataclasses
import warnings

import numpy as np
import pytest

from vislam_ros.core.filters.joint import JointSettings
from vislam_ros.core.step import KINDS
from vislam_ros.core.verdict.reason import Word
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import evaluate
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import Solution, solve
from vislam_ros.data.trajectory import stamp_text
from vislam_ros.errors import SettingsError, VislamError

DRIVE = simulate(steps=40, landmarks=200).drive


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(DRIVE, smooth=True)


def test_trajectories_have_a_pose_and_a_covariance_for_each_stamp(solution: Solution) -> None:
    assert solution.smoothed is not None
    for trajectory in (solution.trajectory, solution.dead_reckoning, solution.smoothed):
        assert trajectory.stamps.tolist() == DRIVE.feature_stamps.tolist()
        assert trajectory.covariances is not None
        assert trajectory.covariances.shape == (DRIVE.steps, 6, 6)
    # The end knows as much as the filter did there; what lies before, more.
    filtered, smoothed = solution.trajectory.covariances, solution.smoothed.covariances
    assert filtered is not None
    assert smoothed is not None
    # But for the spread between bias and none, which lies in one direction.
    spread = np.linalg.eigvalsh(filtered[-1] - smoothed[-1])
    np.testing.assert_allclose(spread[:-1], 0.0, rtol=0, atol=1e-12)
    assert 0.0 <= spread[-1] < 0.01 * np.trace(filtered[-1])
    assert np.trace(smoothed[20]) < np.trace(filtered[20])


def test_the_steps_are_a_table_of_numbers(solution: Solution) -> None:
    assert {len(column) for column in solution.steps.values()} == {DRIVE.steps}
    for name, column in solution.steps.items():
        assert column.dtype == np.dtype(KINDS.get(name, float)), name
    assert solution.steps["stamp"].tolist() == DRIVE.feature_stamps.tolist()
    assert solution.steps["observed"].tolist() == np.diff(DRIVE.offsets).tolist()


def test_pandas_takes_the_steps_as_they_are(solution: Solution) -> None:
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(solution.steps)
    assert table.shape == (DRIVE.steps, len(solution.steps))
    assert object not in set(table.dtypes)
    assert table["used"].sum() == solution.steps["used"].sum()


def test_the_summary_tells_of_the_steps(solution: Solution) -> None:
    summary = solution.summary
    assert (summary["drive"], summary["estimator"]) == ("simulated", "robocentric")
    assert (summary["steps"], summary["complete"]) == (DRIVE.steps, True)
    assert summary["landmarks"] == len(solution.landmarks)
    assert summary["observations"] == solution.steps["observed"].sum()


def test_the_summary_has_the_verdict(solution: Solution) -> None:
    assert solution.verdict is not None
    assert solution.summary["verdict"] == solution.verdict.word.value
    assert solution.summary["verdict_reasons"] == list(solution.verdict.reasons)


@pytest.mark.parametrize(
    ("moves", "begin"),
    [(slice(None, 60), 60), (slice(40, None), 0)],
    ids=["motion ends early", "motion begins late"],
)
def test_a_drive_whose_frames_have_no_pose_is_doubtful(moves: slice, begin: int) -> None:
    drive = simulate(steps=100, landmarks=500, seed=4).drive
    assert solve(drive).verdict == (int(drive.feature_stamps[-1]), Word.GOOD, ())
    cut = dataclasses.replace(
        drive, twist_stamps=drive.twist_stamps[moves], twists=drive.twists[moves]
    )
    solution = solve(cut)
    assert (len(solution.trajectory), solution.summary["complete"]) == (60, True)
    assert solution.verdict is not None
    assert solution.verdict.word is Word.DOUBTFUL
    (reason,) = solution.verdict.reasons
    first = int(drive.feature_stamps[begin])
    assert reason.startswith("40% of the frames have no pose: 40 features_no_prediction (no ")
    assert reason.endswith(f"the first at {stamp_text(first)} s)")
    assert solution.summary["verdict_reasons"] == [reason]


def test_settings_by_name_are_put_over_those_given() -> None:
    by_name = solve(DRIVE, estimator="joint", min_disparity=2)
    by_class = solve(DRIVE, JointSettings(min_disparity=2.0))
    over = solve(DRIVE, JointSettings(min_disparity=9.0), min_disparity=2.0)
    assert by_name.summary["estimator"] == "joint"
    for other in (by_class, over):
        np.testing.assert_array_equal(by_name.trajectory.positions, other.trajectory.positions)
    with pytest.raises(SettingsError, match="min_disparty: no such parameter; did you mean"):
        solve(DRIVE, min_disparty=2.0)


def test_a_setting_that_the_estimator_does_not_use_is_warned_of() -> None:
    with pytest.warns(UserWarning, match="^min_disparity: set, but not used by estimator robo"):
        solve(DRIVE, min_disparity=2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solve(DRIVE, min_disparity=1.0)


def test_a_drive_without_frames_has_a_table_without_rows() -> None:
    none = Drive.from_tracks([0.0], [[]], [[]], np.zeros((1, 6)), DRIVE.camera, twist_stamps=[5.0])
    with pytest.warns(UserWarning, match=r"^tracks: incomplete: not one step: 1 features_bad_st"):
        solution = solve(none)
    assert set(solution.steps) == set(KINDS)
    assert len(solution.trajectory) == len(solution.steps["stamp"]) == 0
    assert solution.verdict is None
    with pytest.raises(VislamError, match=r"^the estimate has no pose"):
        evaluate(solution.trajectory, solve(DRIVE).trajectory)


def test_a_crowd_is_followed_as_far_as_there_is_room_and_the_rest_is_counted() -> None:
    drive = simulate(steps=8, landmarks=4000, seed=1).drive
    crowd = np.diff(drive.offsets)
    assert crowd.min() > 1000
    solution = solve(drive, max_active=60)
    steps = solution.steps
    assert steps["active"].max() == 60
    assert steps["observed"].tolist() == crowd.tolist()
    assert steps["left_out"][0] == crowd[0] - 60
    assert solution.summary["left_out"] == steps["left_out"].sum()
    assert solution.summary["complete"]
    everything = solve(drive, max_active=20_000, estimator="mapping")
    assert everything.steps["left_out"].sum() == 0


def test_a_gyroscope_alone_is_nearly_as_good_as_twists() -> None:
    drive = simulate(steps=150, landmarks=700, seed=4, velocity_noise_std=0.02).drive
    assert drive.ground_truth is not None
    errors = {
        source: evaluate(solve(drive, motion_source=source).trajectory, drive.ground_truth)
        for source in ("twist", "gyro")
    }
    assert errors["gyro"].ate.rmse < 1.5 * errors["twist"].ate.rmse + 0.05


def test_the_velocity_of_a_gyroscope_s_start_is_found_at_once_and_not_believed_before() -> None:
    drive = simulate(steps=20, landmarks=300, seed=4).drive
    gyro = solve(drive, motion_source="gyro").steps
    assert gyro["velocity_std_x"][0] > 40.0
    speed = solve(drive).steps["velocity_x"][-1]
    for k in (2, 3):
        off = abs(gyro["velocity_x"][k] - speed)
        assert off < 0.2 * speed
        assert gyro["velocity_std_x"][k] < 0.1 * speed


def test_twists_are_not_to_be_had_from_a_gyroscope() -> None:
    with pytest.raises(VislamError, match=r"no velocities.*take gyro"):
        solve(DRIVE.moved_by("gyro"), motion_source="twist")
