# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tracked_drive import increments

from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment, Part
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.verdict import evidence as module
from vislam_ros.core.verdict.evidence import REACH, Evidence
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

PERIOD = 100_000_000


@pytest.fixture(scope="module")
def drive() -> Drive:
    exact = SimulationSettings(
        steps=160,
        landmarks=900,
        pixel_noise_std=0.02,
        velocity_noise_std=0.0,
        angular_velocity_noise_std=0.0,
        gyro_bias=(0.0, 0.0, 0.0),
        outlier_share=0.0,
        seed=2,
    )
    return simulate(exact).drive


def gathered(drive: Drive, *, frozen: frozenset[int] = frozenset()) -> Evidence:
    evidence = Evidence()
    for k, increment in enumerate(increments(drive, SlamSettings())):
        evidence.add(
            int(drive.feature_stamps[k]),
            *drive.frame(k),
            increment,
            drive.camera,
            frozen=k in frozen,
        )
    return evidence


def steps_of(evidence: Evidence, drive: Drive) -> list[int]:
    """Frames at which the later steps of all pairs end."""
    return [drive.feature_stamps.tolist().index(pair.stamp) for pair in evidence.pairs()]


def test_both_steps_of_a_pair_have_the_motion_of_images_and_the_twists_around(
    drive: Drive,
) -> None:
    evidence = gathered(drive)
    assert len(evidence.pairs()) >= 16
    for pair, k in zip(evidence.pairs(), steps_of(evidence, drive), strict=True):
        assert pair.tau == pytest.approx([0.1, 0.1], abs=1e-6)
        for half, step in enumerate((k - 2, k)):
            told = drive.twists[max(step - REACH, 1) : step + REACH + 1]
            assert_allclose(pair.twists[half][-len(told) :], told, atol=1e-9)
            # What the twist predicts and what the images saw is the same motion.
            xi = pair.tau[half] * (drive.camera.camera_from_body_twist @ drive.twists[step])
            error = pair.motion[half] - xi
            assert error @ pair.metric @ error < 0.2**2


def test_the_steps_of_a_pair_have_no_frame_in_common_whatever_the_rate(drive: Drive) -> None:
    fast = dataclasses.replace(
        drive,
        feature_stamps=drive.feature_stamps[0] + np.arange(drive.steps) * (PERIOD // 5),
        twist_stamps=drive.twist_stamps[0] + np.arange(drive.steps) * (PERIOD // 5),
    )
    for each, apart in ((drive, 2), (fast, 8)):
        pair = gathered(each).pairs()[0]
        k = each.feature_stamps.tolist().index(pair.stamp)
        assert_allclose(pair.twists[0][REACH], each.twists[k - apart], atol=1e-9)


def test_frozen_frames_and_those_with_few_tracks_are_passed_over(drive: Drive) -> None:
    frozen = frozenset(range(0, drive.steps, 3))
    used = steps_of(gathered(drive, frozen=frozen), drive)
    assert used
    assert not set(used) & frozen
    few = dataclasses.replace(
        drive,
        offsets=5 * np.arange(drive.steps + 1),
        ids=np.tile(np.arange(5, dtype=np.uint32), drive.steps),
        pixels=np.resize(drive.pixels, (5 * drive.steps, 4)),
    )
    assert gathered(few).pairs() == []
    assert sum(gathered(few).looks) == 0


def test_the_order_of_a_frames_tracks_does_not_matter(drive: Drive) -> None:
    rng = np.random.default_rng(3)
    order = np.concatenate(
        [
            begin + rng.permutation(end - begin)
            for begin, end in zip(drive.offsets[:-1], drive.offsets[1:], strict=True)
        ]
    )
    mixed = dataclasses.replace(drive, ids=drive.ids[order], pixels=drive.pixels[order])
    one, other = gathered(drive).pairs(), gathered(mixed).pairs()
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        error = a.motion - b.motion
        assert np.max(np.sum((error @ a.metric) * error, axis=1)) < 0.2**2


def test_clear_disparities_are_counted_by_their_sign(drive: Drive) -> None:
    looks = gathered(drive).looks
    exchanged = gathered(dataclasses.replace(drive, pixels=drive.pixels[:, [2, 3, 0, 1]])).looks
    assert looks.positive > 100
    assert looks.negative == 0
    assert (exchanged.negative, exchanged.positive) == (looks.positive, looks.negative)
    assert looks.rigid > 30
    assert looks.loose == 0


def test_the_latest_pairs_and_looks_are_those_since_a_stamp(drive: Drive) -> None:
    evidence = gathered(drive)
    stamps = [pair.stamp for pair in evidence.pairs()]
    middle = stamps[len(stamps) // 2]
    assert [pair.stamp for pair in evidence.pairs(middle)] == [s for s in stamps if s >= middle]
    assert evidence.looks_since(0) == evidence.looks
    assert 0 < evidence.looks_since(middle).rigid < evidence.looks.rigid


def test_memory_is_bounded_and_what_is_kept_is_spread_over_the_drive(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MOST_PAIRS", 8)
    all_pairs = gathered(drive)
    kept = [pair.stamp for pair in all_pairs.pairs()]
    assert len(kept) <= 8
    assert all_pairs.gathered > 8
    assert (kept[-1] - kept[0]) > 0.6 * (drive.feature_stamps[-1] - drive.feature_stamps[0])
    assert all_pairs.pairs(0)[-1].stamp >= kept[-1]


def test_the_twist_of_a_step_with_many_samples_is_that_of_its_motion(drive: Drive) -> None:
    evidence, twist = Evidence(), np.array([9.0, 0.1, 0.0, 0.0, 0.0, 0.3])
    half = Part(0.05, twist)
    increment = Increment(se3.exp(0.1 * twist), 0.1, np.zeros((6, 6)), (half, half))
    for k in range(40):
        stamp = int(drive.feature_stamps[k])
        evidence.add(stamp, *drive.frame(k), increment, drive.camera, frozen=False)
    pair = evidence.pairs()[-1]
    assert_allclose(pair.twists, np.broadcast_to(twist, (2, 2 * REACH + 1, 6)), atol=1e-9)
