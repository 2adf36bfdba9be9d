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
    increment = path_of([0, STEP, 2 * STEP]).increment(STEP, 2 * STEP, 0.1)
    assert_allclose(increment.T, se3.exp(0.1 * TWIST), atol=1e-12)
    assert_allclose(increment.covariance, process_covariance(SETTINGS, 0.1))
    assert increment.duration == 0.1


def test_several_samples_between_two_frames_add_up_their_noise() -> None:
    increment = path_of(range(0, 6 * STEP, STEP)).increment(STEP, 4 * STEP, 0.1)
    covariance = np.zeros((6, 6))
    sample = Increment(se3.exp(0.1 * TWIST), 0.1, process_covariance(SETTINGS, 0.1))
    for _ in range(3):
        covariance = propagate(covariance, sample)
    assert_allclose(increment.T, se3.exp(0.3 * TWIST), atol=1e-12)
    assert_allclose(increment.covariance, covariance, atol=1e-12)


def test_each_sample_counts_once_at_its_own_stamp() -> None:
    path = path_of(range(0, 6 * STEP, STEP))
    (whole,) = path.increment(STEP, 2 * STEP, 0.1).parts
    assert whole.duration == 0.1
    assert_allclose(whole.measured, TWIST)
    for begin, end in ((STEP // 2, 7 * STEP // 2), (0, 4 * STEP), (STEP, 5 * STEP // 4)):
        increment = path.increment(begin, end, 0.1)
        assert_allclose(sum(part.duration for part in increment.parts), increment.duration)
        measured = [part.measured for part in increment.parts if part.measured is not None]
        assert len(measured) == end // STEP - begin // STEP
        for twist in measured:
            assert_allclose(twist, TWIST, atol=1e-9)


def test_where_samples_are_missing_the_next_one_stands_for_no_longer_than_usual() -> None:
    path = path_of([0, STEP, 2 * STEP, 12 * STEP, 13 * STEP])
    silent, late = path.increment(2 * STEP, 12 * STEP, 0.1).parts
    assert silent.measured is None
    assert_allclose((silent.duration, late.duration), (0.9, 0.1))
    assert [part.measured is None for part in path.increment(4 * STEP, 5 * STEP, 0.1).parts] == [
        True
    ]
    assert [part.duration for part in path.increment(12 * STEP, 13 * STEP, 0.1).parts] == [0.1]


def test_a_lost_prediction_costs_only_process_noise() -> None:
    whole = path_of([0, STEP, 2 * STEP, 3 * STEP]).increment(0, 3 * STEP, 0.1)
    gap = path_of([0, STEP, 3 * STEP]).increment(0, 3 * STEP, 0.1)
    assert_allclose(gap.T, whole.T, atol=1e-12)
    assert np.trace(gap.covariance) > np.trace(whole.covariance)


def test_a_pose_between_two_stamps_is_interpolated() -> None:
    path = path_of([0, STEP, 2 * STEP])
    assert_allclose(path.pose(STEP // 4), se3.exp(0.025 * TWIST), atol=1e-12)
    halves = [path.increment(0, STEP // 4, 0.1), path.increment(STEP // 4, STEP, 0.1)]
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
    whole = path.increment(begin, end, 0.1)
    assert_allclose(forgetful.increment(begin, end, 0.1).T, whole.T)
    assert forgetful.begins_after(2 * STEP)


IMU_STEP = 5_000_000


def turning(k: int) -> np.ndarray:
    """Pose after k samples of a turn that changes all the time."""
    T = np.eye(4)
    for j in range(k):
        T = T @ se3.exp(5e-3 * np.array([1.0, 0.0, 0.0, 0.3, np.sin(0.05 * j), 1.0]))
    return T


def test_the_mean_of_many_samples_moves_the_body_as_they_do_and_is_one_measurement() -> None:
    path = PredictedPath(SETTINGS)
    for k in range(61):
        path.add(k * IMU_STEP, turning(k))
    # Frames need not have the stamp of a sample.
    begin, end = 20 * IMU_STEP + 1_234_567, 40 * IMU_STEP + 1_234_567
    (part,) = path.increment(begin, end, 0.1).parts
    assert_allclose(part.duration, 0.1)
    assert part.measured is not None
    moved = se3.inverse(path.pose(begin)) @ path.pose(end)
    assert_allclose(se3.exp(part.duration * part.measured), moved, atol=1e-12)


def test_a_long_step_of_many_samples_has_a_mean_for_each_usual_one() -> None:
    path = PredictedPath(SETTINGS)
    for k in range(101):
        path.add(k * IMU_STEP, turning(k))
    increment = path.increment(0, 100 * IMU_STEP, 0.1)
    assert_allclose([part.duration for part in increment.parts], 5 * [0.1])
    motion = np.eye(4)
    for duration, twist in increment.parts:
        assert twist is not None
        motion = motion @ se3.exp(duration * twist)
    assert_allclose(motion, increment.T, atol=1e-12)


def test_where_many_samples_are_missing_nothing_is_measured() -> None:
    path = PredictedPath(SETTINGS)
    for k in [*range(10), *range(30, 41)]:
        path.add(k * IMU_STEP, turning(k))
    parts = path.increment(0, 40 * IMU_STEP, 0.1).parts
    assert [part.measured is None for part in parts] == [False, True, False]
    assert_allclose([part.duration for part in parts], [0.045, 0.1, 0.055])


def test_of_a_gyroscope_alone_the_rotation_is_measured_and_no_velocity() -> None:
    path, whole = PredictedPath(SETTINGS), path_of(range(0, 3 * STEP, STEP))
    for k in range(3):
        T = se3.exp(0.1 * k * TWIST)
        T[:3, 3] = 0.0
        path.add(k * STEP, T, velocity_known=False)
    increment = path.increment(STEP, 2 * STEP, 0.1)
    (part,) = increment.parts
    assert part.measured is not None
    assert np.isnan(part.measured[:3]).all()
    assert_allclose(part.measured[3:], TWIST[3:])
    assert not increment.measures_velocity
    assert_allclose(
        increment.moved_at(TWIST[:3]), whole.increment(STEP, 2 * STEP, 0.1).T, atol=1e-12
    )
    # Five metres in a tenth of a second: nothing is known but that it is a vehicle.
    assert_allclose(np.diag(increment.covariance)[:3], 5.0**2)
