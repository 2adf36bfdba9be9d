# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Each reading undoes what it says."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reliability.disturbances import DISTURBANCES
from reliability.verdicts import UNDISTURBED

from vislam_ros.core.verdict.readings import Reading, as_given, other_readings
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate

READ_WRONG = {
    "extrinsics inverted": "T_body_camera inverted",
    "extrinsics to forward-left-up camera": "T_body_camera as to forward-left-up camera axes",
    "the same, inverted": "T_body_camera inverted, as to forward-left-up camera axes",
    "twists forward-right-down": "twists in forward-right-down axes",
    "twists in optical axes": "twists in optical axes (x right, y down, z forward)",
    "angular velocity negative": "angular velocities of the other sign",
    "velocity negative": "velocities of the other sign",
}


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(steps=20, landmarks=200).drive


def readings(drive: Drive) -> dict[str, Reading]:
    return {each.words: each for each in itertools.chain(*other_readings(drive.camera))}


@pytest.mark.parametrize("name", READ_WRONG)
def test_a_reading_gives_the_cameras_twist_as_it_was(drive: Drive, name: str) -> None:
    wrong = DISTURBANCES[name].change(drive)
    right = drive.twists @ as_given(drive.camera).T
    reading = readings(wrong)[READ_WRONG[name]]
    assert_allclose(wrong.twists @ reading.camera_from_twist.T, right, atol=1e-9)
    assert not np.allclose(wrong.twists @ as_given(wrong.camera).T, right, atol=0.1)


def test_two_things_may_be_wrong_at_once(drive: Drive) -> None:
    wrong = DISTURBANCES["twists forward-right-down"].change(
        DISTURBANCES["extrinsics inverted"].change(drive)
    )
    words = f"{READ_WRONG['extrinsics inverted']} and {READ_WRONG['twists forward-right-down']}"
    reading = readings(wrong)[words]
    right = drive.twists @ as_given(drive.camera).T
    assert_allclose(wrong.twists @ reading.camera_from_twist.T, right, atol=1e-9)


def test_no_reading_stands_there_twice_and_none_is_the_one_given(drive: Drive) -> None:
    found = readings(drive)
    matrices = [as_given(drive.camera), *(each.camera_from_twist for each in found.values())]
    assert len(found) == len(READ_WRONG) + 3
    for a, b in itertools.combinations(matrices, 2):
        assert not np.allclose(a, b, atol=0.1)
    assert UNDISTURBED not in DISTURBANCES
