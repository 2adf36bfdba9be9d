# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What images and twists say of each other, whatever filter runs."""

import dataclasses
import re
from typing import Any

import numpy as np
import pytest
from reliability.disturbances import DISTURBANCES
from tracked_drive import increments

from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.verdict.contradiction import contradictions
from vislam_ros.core.verdict.evidence import Evidence
from vislam_ros.core.verdict.reason import Reason, Word
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.simulation.simulated_drive import SimulatedDrive

SETTINGS: dict[str, Any] = {"steps": 300, "landmarks": 1320, "frozen_share": 0.08}
NOISES: dict[str, dict[str, Any]] = {
    "quiet twist": {"velocity_noise_std": 0.02, "angular_velocity_noise_std": 0.003},
    "noisy twist": {"velocity_noise_std": 0.5, "angular_velocity_noise_std": 0.05},
}
CONTRADICTIONS = [
    name for name in DISTURBANCES if not re.search("features|slide|frame|exchanged$|mixed", name)
]


@pytest.fixture(scope="module", params=NOISES)
def simulated(request: pytest.FixtureRequest) -> SimulatedDrive:
    return simulate(**SETTINGS, **NOISES[request.param], seed=8)


@pytest.fixture(scope="module")
def quiet() -> SimulatedDrive:
    return simulate(**SETTINGS, **NOISES["quiet twist"], seed=8)


def reasons(simulated: SimulatedDrive, disturbed: Drive | None = None) -> list[Reason]:
    """What is said of a drive, or of what became of it."""
    drive = disturbed or simulated.drive
    covered = drive.feature_stamps <= drive.twist_stamps[-1]
    drive = dataclasses.replace(drive, feature_stamps=drive.feature_stamps[covered])
    evidence = Evidence()
    for k, increment in enumerate(increments(drive, SlamSettings())):
        evidence.add(
            int(drive.feature_stamps[k]),
            *drive.frame(k),
            increment,
            drive.camera,
            frozen=bool(simulated.frozen[k]),
        )
    return list(contradictions(evidence.pairs(), drive.camera))


def with_twists(simulated: SimulatedDrive, velocity: float, angular_velocity: float) -> Drive:
    factors = np.repeat([velocity, angular_velocity], 3)
    return dataclasses.replace(simulated.drive, twists=simulated.drive.twists * factors)


def test_nothing_is_said_of_a_drive_that_is_as_it_should_be(simulated: SimulatedDrive) -> None:
    assert reasons(simulated) == []


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_what_contradicts_is_named(quiet: SimulatedDrive, name: str) -> None:
    disturbance = DISTURBANCES[name]
    said = reasons(quiet, disturbance.change(quiet.drive))
    assert disturbance.named in said[0].text
    assert "\n" not in said[0].text


def test_inverted_extrinsics_are_told_at_any_noise_and_what_inverting_them_would_leave(
    simulated: SimulatedDrive,
) -> None:
    disturbed = DISTURBANCES["extrinsics inverted"].change(simulated.drive)
    (reason,) = reasons(simulated, disturbed)
    assert reason.word is Word.CONTRADICTION
    match = re.search(
        r"by (\S+) px in a step .* by (\S+) px: .*T_body_camera inverted would fit \((\S+) px\)",
        reason.text,
    )
    assert match
    mismatch, flow, left = map(float, match.groups())
    assert left < flow / 4
    assert mismatch > flow


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.25, 2.0])
def test_a_scale_is_told_as_large_as_it_is(simulated: SimulatedDrive, factor: float) -> None:
    (reason,) = reasons(simulated, with_twists(simulated, factor, 1.0))
    match = re.search(r"velocity of the twists is (\S+) times", reason.text)
    assert match
    assert float(match[1]) == pytest.approx(factor, rel=0.1)


def test_a_scale_within_a_calibrations_error_is_left_alone(simulated: SimulatedDrive) -> None:
    assert reasons(simulated, with_twists(simulated, 1.05, 0.95)) == []


def test_a_unit_that_is_often_mistaken_is_named(quiet: SimulatedDrive) -> None:
    assert "km/h" in reasons(quiet, with_twists(quiet, 3.6, 1.0))[0].text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("twists 5 frames late", "5 steps late"),
        ("twists 5 frames early", "5 steps early"),
        ("twists 3 frames late", "3 steps late"),
    ],
)
def test_twists_of_other_steps_are_doubtful(quiet: SimulatedDrive, name: str, words: str) -> None:
    (reason,) = reasons(quiet, DISTURBANCES[name].change(quiet.drive))
    assert words in reason.text
    assert reason.word is Word.DOUBTFUL


def test_a_bias_of_the_gyroscope_is_no_contradiction() -> None:
    assert reasons(simulate(**SETTINGS, gyro_bias=(0.02, -0.02, 0.02), seed=8)) == []


def test_of_a_drive_too_short_to_tell_nothing_is_said(quiet: SimulatedDrive) -> None:
    wrong = DISTURBANCES["extrinsics inverted"].change(quiet.drive)
    for steps, said in ((24, 0), (80, 1)):
        short = dataclasses.replace(wrong, feature_stamps=wrong.feature_stamps[:steps])
        assert len(reasons(quiet, short)) == said


def test_a_noise_that_hides_all_turning_makes_no_scale_of_it() -> None:
    settings = {**SETTINGS, "angular_velocity_noise_std": 0.5, "steps": 120, "landmarks": 600}
    assert reasons(simulate(**settings, seed=8)) == []


def test_of_a_gyroscope_alone_the_rotation_is_held_against_the_images(
    quiet: SimulatedDrive,
) -> None:
    drive = quiet.drive.moved_by("gyro")
    assert reasons(quiet, drive) == []
    turned = drive.twists * np.array([1, 1, 1, 1, -1, -1])
    (reason,) = reasons(quiet, dataclasses.replace(drive, twists=turned))
    assert reason.word is Word.CONTRADICTION
