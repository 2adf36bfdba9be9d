# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numpy.testing import assert_allclose

from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment, process_covariance, propagate
from vislam_ros.core.settings import MotionSettings
from vislam_ros.core.tracking.pairing import PredictedPath

STEP = 100_000_000
SETTINGS = MotionSettings(velocity_noise_std=0.4, angular_velocity_noise_std=0.03)
TWIST = np.array([8.0, 0.2, -0.1, 0.02, -0.05, 0.4])


def path_of(stamps: list[int] | range) -> PredictedPath:
    path = PredictedPath(SETTINGS)
    for stamp in stamps:
        path.add(stamp, se3.exp(stamp * 1e-9 * TWIST))
    return path


def test_between_two_neighbours_the_noise_is_one_samples() -> None:
    increment = path_of([0, STEP, 2 * STEP]).increment(STEP, 2 * STEP)
    assert_allclose(increment.T, se3.exp(0.1 * TWIST), atol=1e-12)
    assert_allclose(increment.covariance, process_covariance(SETTINGS, 0.1))
    assert increment.duration == 0.1


def test_several_samples_between_two_frames_add_up_their_noise() -> None:
    increment = path_of(range(0, 6 * STEP, STEP)).increment(STEP, 4 * STEP)
    covariance = np.zeros((6, 6))
    sample = Increment(se3.exp(0.1 * TWIST), 0.1, process_covariance(SETTINGS, 0.1))
    for _ in range(3):
        covariance = propagate(covariance, sample)
    assert_allclose(increment.T, se3.exp(0.3 * TWIST), atol=1e-12)
    assert_allclose(increment.covariance, covariance, atol=1e-12)


def test_each_sample_counts_once_at_its_own_stamp() -> None:
    path = path_of(range(0, 6 * STEP, STEP))
    (whole,) = path.increment(STEP, 2 * STEP).parts
    assert whole.duration == 0.1
    assert_allclose(whole.measured, TWIST)
    for begin, end in ((STEP // 2, 7 * STEP // 2), (0, 4 * STEP), (STEP, 5 * STEP // 4)):
        increment = path.increment(begin, end)
        assert_allclose(sum(part.duration for part in increment.parts), increment.duration)
        measured = [part.measured for part in increment.parts if part.measured is not None]
        assert len(measured) == end // STEP - begin // STEP
        for twist in measured:
            assert_allclose(twist, TWIST, atol=1e-9)


def test_where_samples_are_missing_the_next_one_stands_for_no_longer_than_usual() -> None:
    path = path_of([0, STEP, 2 * STEP, 12 * STEP, 13 * STEP])
    silent, late = path.increment(2 * STEP, 12 * STEP).parts
    assert silent.measured is None
    assert_allclose((silent.duration, late.duration), (0.9, 0.1))
    assert [part.measured is None for part in path.increment(4 * STEP, 5 * STEP).parts] == [True]
    assert [part.duration for part in path.increment(12 * STEP, 13 * STEP).parts] == [0.1]


def test_a_lost_prediction_costs_only_process_noise() -> None:
    whole = path_of([0, STEP, 2 * STEP, 3 * STEP]).increment(0, 3 * STEP)
    gap = path_of([0, STEP, 3 * STEP]).increment(0, 3 * STEP)
    assert_allclose(gap.T, whole.T, atol=1e-12)
    assert np.trace(gap.covariance) > np.trace(whole.covariance)


def test_a_pose_between_two_stamps_is_interpolated() -> None:
    path = path_of([0, STEP, 2 * STEP])
    assert_allclose(path.pose(STEP // 4), se3.exp(0.025 * TWIST), atol=1e-12)
    halves = [path.increment(0, STEP // 4), path.increment(STEP // 4, STEP)]
    variance = sum(np.diag(part.covariance)[3:] for part in halves)
    assert_allclose(variance, np.diag(process_covariance(SETTINGS, 0.1))[3:], rtol=1e-2)


def test_a_path_knows_which_stamps_it_can_tell() -> None:
    path = path_of([STEP, 2 * STEP])
    assert path.begins_after(0)
    assert not path.begins_after(STEP)
    assert path.reaches(2 * STEP)
    assert not path.reaches(2 * STEP + 1)
    assert not PredictedPath(SETTINGS).begins_after(0)
    assert not PredictedPath(SETTINGS).reaches(0)


def test_forgetting_keeps_what_later_stamps_need() -> None:
    path, forgetful = path_of(range(0, 9 * STEP, STEP)), path_of(range(0, 9 * STEP, STEP))
    forgetful.forget_before(3 * STEP + STEP // 2)
    begin, end = 3 * STEP + STEP // 2, 7 * STEP
    assert_allclose(forgetful.increment(begin, end).T, path.increment(begin, end).T)
    assert forgetful.begins_after(2 * STEP)
