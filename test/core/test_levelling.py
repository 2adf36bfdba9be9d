# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A body is levelled where it stands, and nothing is claimed where it does not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vislam_ros.core.geometry import se3
from vislam_ros.core.levelling import GRAVITY, LARGEST_GYRO_OFFSET, Levelling, level_attitude

RATE = 200
TURNED = se3.exp_rotation([0.3, -0.5, 0.0])
UP = GRAVITY * TURNED[2]  # in the body's axes
BIAS = np.array([-0.002, 0.02, 0.078])  # of EuRoC's gyroscope


def samples(seconds=1.0, *, rate=RATE, force_noise=0.05, turn_noise=0.003, seed=1):
    """Stamps, angular velocities and forces of a body that stands."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate) + 1
    stamps = 1_700_000_000_000_000_000 + np.arange(n) * (1_000_000_000 // rate)
    omegas = BIAS + turn_noise * rng.standard_normal((n, 3))
    return stamps, omegas, UP + force_noise * rng.standard_normal((n, 3))


def levelled(stamps, omegas, forces):
    """Attitude, and how many samples it took; None of these where no end came."""
    levelling = Levelling()
    for k, sample in enumerate(zip(stamps, omegas, forces, strict=True)):
        if levelling.add(int(sample[0]), *sample[1:]):
            return levelling.R_world_body, k + 1
    return levelling.R_world_body, None


def tilt(R_world_body, upward):
    """Angle between what an attitude takes for upward, and what is (degrees)."""
    cosine = R_world_body[2] @ upward / np.linalg.norm(upward)
    return np.degrees(np.arccos(min(cosine, 1.0)))


@pytest.mark.parametrize("rate", [10, 100, 200, 1000])
def test_one_that_stands_is_levelled_after_half_a_second(rate):
    R, taken = levelled(*samples(rate=rate))
    assert taken == round(0.5 * rate) + 1
    assert tilt(R, UP) < 0.3
    assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert R[1, 0] == 0.0, "its x axis has no part to the left: the yaw is 0"
    assert R[0, 0] > 0.0


def test_running_rotors_shake_it_and_it_stands():
    R, _ = levelled(*samples(force_noise=0.6, turn_noise=0.02))
    assert tilt(R, UP) < 1.0


def moving(forces, **_):
    forces += np.linspace(0.0, 1.0, len(forces))[:, None] * [2.0, 0.0, 0.0]


def speeding(forces, **_):
    forces += TURNED.T @ [2.5, 0.0, 0.0]


def falling(forces, **_):
    forces[:] *= 0.02


def swinging(omegas, **_):
    omegas[:, 0] += 0.1 * np.sin(np.arange(len(omegas)) / RATE * 2 * np.pi)


def circling(omegas, **_):
    omegas[:, 2] += 1.05 * LARGEST_GYRO_OFFSET


@pytest.mark.parametrize("move", [moving, speeding, falling, swinging, circling])
def test_one_that_moves_is_not_levelled_and_not_held(move):
    stamps, omegas, forces = samples()
    move(forces=forces, omegas=omegas)
    R, taken = levelled(stamps, omegas, forces)
    assert R is None
    assert taken is not None


def test_a_sample_without_a_force_ends_it():
    stamps, omegas, forces = samples()
    assert levelled(stamps, omegas, [None] * len(forces)) == (None, 1)
    R, taken = levelled(stamps, omegas, [*forces[:40], None, *forces[41:]])
    assert (R, taken) == (None, 41)


def test_samples_too_far_apart_tell_nothing():
    assert levelled(*samples(2.0, rate=4)) == (None, 2)
    stamps, omegas, forces = samples()
    stamps[30:] += 200_000_000
    assert levelled(stamps, omegas, forces) == (None, 31)


def test_less_than_half_a_second_is_not_enough():
    assert levelled(*samples(0.495)) == (None, None)


@pytest.mark.parametrize("roll", [-3.0, 0.0, 0.4, 2.0])
@pytest.mark.parametrize("pitch", [-1.5, 0.0, 0.7])
def test_the_level_attitude_is_that_of_roll_and_pitch(roll, pitch):
    R = se3.exp_rotation([0.0, pitch, 0.0]) @ se3.exp_rotation([roll, 0.0, 0.0])
    assert_allclose(level_attitude(3.0 * R[2]), R, atol=1e-12)


@pytest.mark.parametrize("x", [1.0, -1.0])
def test_one_that_points_straight_up_or_down_is_level_too(x):
    R = level_attitude(np.array([x, 0.0, 0.0]))
    assert_allclose(R[2], [x, 0.0, 0.0])
    assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
