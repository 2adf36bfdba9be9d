# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import GRAVITY
from vislam_ros.core.settings import PredictionSettings

SECOND = 1_000_000_000


def test_the_first_twist_starts_at_the_identity_and_comes_out_with_the_second():
    reckoning = DeadReckoning(PredictionSettings())
    assert reckoning.add_twist(5 * SECOND, [1, 0, 0, 0, 0, 1]) == []
    first, second = reckoning.add_twist(6 * SECOND, [1, 0, 0, 0, 0, 1])
    assert (first.stamp, second.stamp) == (5 * SECOND, 6 * SECOND)
    assert_allclose(first.position, 0)
    assert_allclose(first.quaternion, [0, 0, 0, 1])
    assert_allclose(first.covariance, 0)


def test_a_twist_holds_over_the_interval_that_ends_at_its_stamp():
    reckoning = DeadReckoning(PredictionSettings())
    reckoning.add_twist(0, [100, 0, 0, 0, 0, 0])
    _, pose = reckoning.add_twist(SECOND // 2, [2, 0, 0, 0, 0, 0])
    assert_allclose(pose.position, [1, 0, 0])


def test_a_constant_twist_drives_a_circle():
    reckoning = DeadReckoning(PredictionSettings())
    for k in range(101):
        poses = reckoning.add_twist(k * SECOND // 100, [2 * np.pi, 0, 0, 0, 0, 2 * np.pi])
    (pose,) = poses
    assert_allclose(pose.position, 0, atol=1e-12)
    assert_allclose(se3.rotation_from_quaternion(pose.quaternion), np.eye(3), atol=1e-12)


def test_covariance_is_that_of_a_monte_carlo():
    settings = PredictionSettings(velocity_noise_std=0.3, angular_velocity_noise_std=0.05)
    rng = np.random.default_rng(8)
    twists = np.array([5, 0, 0, 0, 0, 0.5]) + rng.standard_normal((20, 6)) * 0.1
    std = np.array([0.3] * 3 + [0.05] * 3)
    reckoning = DeadReckoning(settings)
    for k, twist in enumerate(twists):
        poses = reckoning.add_twist(k * SECOND // 10, twist)
    noisy = twists + std * rng.standard_normal((4000, *twists.shape))
    T = np.broadcast_to(np.eye(4), (4000, 4, 4))
    for k in range(1, len(twists)):
        T = T @ se3.exp(0.1 * noisy[:, k])
    (pose,) = poses
    T_hat = se3.pose_matrix(pose.position, pose.quaternion)
    errors = se3.log(se3.inverse(T_hat) @ T)
    # The error of the estimate is on its right: T = T_hat Exp(xi), xi ~ N(0, Sigma).
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(pose.covariance), errors)
    assert nees.mean() / 6 == pytest.approx(1, abs=0.05)


def test_constant_process_noise_adds_the_same_to_each_step():
    settings = PredictionSettings(process_noise="constant", process_variance=1e-4)
    reckoning = DeadReckoning(settings)
    for k in range(4):
        poses = reckoning.add_twist(k * SECOND, np.zeros(6))
    (pose,) = poses
    assert_allclose(pose.covariance, 3e-4 * np.eye(6))


@pytest.mark.parametrize(
    ("stamp", "twist", "reason"),
    [
        (2 * SECOND, [1, 0, 0, 0, 0, np.nan], "non_finite"),
        (2 * SECOND, [np.inf, 0, 0, 0, 0, 0], "non_finite"),
        (2 * SECOND, [1, 0, 0], "wrong_size"),
        (SECOND, [1, 0, 0, 0, 0, 0], "duplicate"),
        (SECOND // 2, [1, 0, 0, 0, 0, 0], "late"),
    ],
)
def test_a_bad_twist_is_refused_and_changes_nothing(stamp, twist, reason):
    refusing, plain = (DeadReckoning(PredictionSettings()) for _ in range(2))
    for reckoning in (refusing, plain):
        reckoning.add_twist(0, np.zeros(6))
        reckoning.add_twist(SECOND, [1, 0, 0, 0, 0, 0.1])
    assert refusing.add_twist(stamp, twist) == []
    assert refusing.refused.counts == {f"twist_{reason}": 1}
    after = [r.add_twist(3 * SECOND, [1, 0, 0, 0, 0, 0.1])[-1] for r in (refusing, plain)]
    assert_allclose(after[0].position, after[1].position)


def test_time_jumping_back_begins_anew():
    reckoning = DeadReckoning(PredictionSettings(time_jump=1.0))
    for k in range(5):
        reckoning.add_twist(k * SECOND, [1, 0, 0, 0, 0, 0])
    assert reckoning.add_twist(0, [1, 0, 0, 0, 0, 0]) == []
    again, _ = reckoning.add_twist(SECOND, [1, 0, 0, 0, 0, 0])
    assert_allclose(again.position, 0)
    assert reckoning.resets == 1


def stamped(stamps):
    """Predictions of twists that turn ever faster, at these stamps in seconds, and refusals."""
    reckoning = DeadReckoning(PredictionSettings())
    predictions = []
    for k, seconds in enumerate(stamps):
        if seconds is not None:
            twist = [1, 0, 0, 0, 0, 0.1 * k]
            predictions += reckoning.add_twist(round(seconds * SECOND), twist)
    return predictions, reckoning


@pytest.mark.parametrize("bad", [0.0, 18.9, -3600.0, 3600.0, 2**31 - 1])
@pytest.mark.parametrize("place", [0, 1, 6])
def test_a_bad_stamp_costs_its_twist_and_nothing_else(bad, place):
    stamps = [20.0 + 0.1 * k for k in range(8)]
    told, reckoning = stamped([*stamps[:place], bad, *stamps[place + 1 :]])
    expected, _ = stamped([*stamps[:place], None, *stamps[place + 1 :]])
    assert [p.position.tobytes() for p in told] == [p.position.tobytes() for p in expected]
    assert [p.stamp for p in told] == [p.stamp for p in expected]
    assert reckoning.refused.counts == {"twist_bad_stamp": 1}
    assert reckoning.resets == 0


def test_what_nothing_confirms_is_told_before_it_is_over():
    _, reckoning = stamped([20.0, 20.1, 50.0])
    assert not reckoning.refused.counts
    assert reckoning.refused_if_over.counts == {"twist_bad_stamp": 1}
    assert reckoning.refused_if_over.first_stamps == {"twist_bad_stamp": 50 * SECOND}


def test_a_gyroscope_turns_the_pose_in_its_place_and_the_covariance_says_what_is_not_known():
    reckoning = DeadReckoning(PredictionSettings(angular_velocity_noise_std=0.0))
    for k in range(201):
        poses = reckoning.add_angular_velocity(k * SECOND // 200, [0.0, 0.0, np.pi / 2])
    (pose,) = poses
    assert not pose.velocity_known
    assert_allclose(pose.position, 0.0)
    quarter = se3.rotation_from_quaternion(pose.quaternion)
    assert_allclose(quarter, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    # A second at up to some 50 m/s: it does not average out over the samples.
    assert_allclose(np.sqrt(np.diag(pose.covariance)[:3]), 50.0)
    assert_allclose(np.diag(pose.covariance)[3:], 0.0)
    assert_allclose(np.sqrt(np.diag(pose.twist_covariance)[:3]), 50.0)
    assert_allclose(pose.twist, [0, 0, 0, 0, 0, np.pi / 2])


@pytest.mark.parametrize("omega", [[0.0, np.nan, 0.0], [0.0, 0.0, 1e4], [0.0, 0.0]])
def test_a_sample_of_a_gyroscope_that_cannot_be_is_refused(omega):
    reckoning = DeadReckoning(PredictionSettings())
    assert reckoning.add_angular_velocity(0, omega) == []
    assert sum(reckoning.refused.counts.values()) == 1
    assert next(iter(reckoning.refused.counts)).startswith("imu_")


def standing(seconds, first=0.0):
    """Samples at 100 Hz of an IMU that stands tilted: stamp (ns), angular velocity and force."""
    force = GRAVITY * se3.exp_rotation([0.2, -0.1, 0.0])[2]
    return [
        (round((first + k / 100) * 1e9), np.array([0.0, 0.0, 0.01]), force)
        for k in range(round(100 * seconds))
    ]


def told(core, samples):
    return [p for sample in samples for p in core.add_angular_velocity(*sample)]


def test_what_stands_begins_level_and_loses_no_sample():
    core = DeadReckoning(PredictionSettings())
    samples = standing(1.0)
    early, late = told(core, samples[:50]), told(core, samples[50:])
    assert not early
    assert [p.stamp for p in late] == [stamp for stamp, *_ in samples]
    R = se3.rotation_from_quaternion(late[0].quaternion)
    assert_allclose(GRAVITY * R[2], samples[0][2], atol=1e-12)
    assert_allclose(late[0].position, 0.0)
    flat = told(DeadReckoning(PredictionSettings()), [(s, omega) for s, omega, _ in samples])
    ours, theirs = ([se3.rotation_from_quaternion(p.quaternion) for p in x] for x in (late, flat))
    assert_allclose(R.T @ ours[-1], theirs[-1], atol=1e-12)


@pytest.mark.parametrize("force", [None, (np.nan, 0.0, 9.81)])
def test_without_an_accelerometer_nothing_is_held_and_nothing_levelled(force):
    core = DeadReckoning(PredictionSettings())
    found = told(core, [(stamp, omega, force) for stamp, omega, _ in standing(0.1)])
    assert len(found) == 10
    assert found[0].quaternion.tolist() == [0.0, 0.0, 0.0, 1.0]


def test_twists_take_over_from_a_gyroscope_where_its_samples_end():
    reckoning = DeadReckoning(PredictionSettings())
    for k in range(11):
        reckoning.add_angular_velocity(k * SECOND // 10, [0, 0, 0])
    assert not reckoning.has_twists
    twist = [2, 0, 0, 0, 0, 0]
    told = [reckoning.add_twist(k * SECOND // 10, twist) for k in (9, 10, 11)]
    assert reckoning.has_twists
    (pose,) = [prediction for predictions in told for prediction in predictions]
    assert (pose.stamp, pose.velocity_known) == (11 * SECOND // 10, True)
    assert_allclose(pose.position, [0.2, 0, 0])
    assert reckoning.refused.counts == {"twist_late": 2}


def test_each_pass_is_levelled_anew_and_what_was_held_before_is_not_lost():
    core = DeadReckoning(PredictionSettings())
    samples = standing(0.3, first=100.0) + standing(1.0)
    found = told(core, samples)
    assert [p.stamp for p in found] == [stamp for stamp, *_ in samples]
    assert core.resets == 1
    assert found[0].quaternion.tolist() == [0.0, 0.0, 0.0, 1.0], "too short to tell"
    assert found[30].quaternion.tolist() != [0.0, 0.0, 0.0, 1.0]
