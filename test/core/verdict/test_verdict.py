# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The verdict of a session that solves a drive, at its end and on the way."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from reliability.disturbances import DISTURBANCES
from reliability.outages import Outage

from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.motion import Increment
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.verdict.reason import Judgement, Reason, Word
from vislam_ros.core.verdict.verdict import Verdict
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.data.solving import feed, solve

SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(steps=160, landmarks=900, seed=3).drive


def verdict(drive: Drive, **settings: Any) -> Judgement:
    judgement = solve(drive, **settings).verdict
    assert judgement is not None
    return judgement


def judged_of(drive: Drive, outcomes: list[tuple[int, int]]) -> Judgement:
    """Judge steps of 0.1 s in which so many observations were used, and so many rejected."""
    judged = Verdict(drive.camera)
    frame = np.empty(0, dtype=np.uint32), np.empty((0, 4), dtype=np.float32)
    still = Increment(np.eye(4), 0.1, np.zeros((6, 6)))
    for k, (used, rejected) in enumerate(outcomes):
        outcome = Outcome(used=used, rejected=np.arange(rejected))
        judged.add(k * SECOND // 10, *frame, still, outcome, frozen=False)
    return judged.judged()


def test_the_worst_reason_gives_the_word_and_stands_first() -> None:
    reasons = [Reason(Word.DOUBTFUL, "a"), Reason(Word.CONTRADICTION, "b")]
    assert Judgement.of(5, reasons) == (5, Word.CONTRADICTION, ("b", "a"))
    assert Judgement.of(5, reasons[:1]) == (5, Word.DOUBTFUL, ("a",))
    assert Judgement.of(5, []) == (5, Word.GOOD, ())


def test_a_doubt_comes_last_and_makes_no_verdict_better() -> None:
    assert Judgement.of(5, []).with_doubt("c") == (5, Word.DOUBTFUL, ("c",))
    wrong = Judgement.of(5, [Reason(Word.CONTRADICTION, "b")])
    assert wrong.with_doubt("c") == (5, Word.CONTRADICTION, ("b", "c"))


def test_a_drive_as_it_should_be_is_good(drive: Drive) -> None:
    assert verdict(drive) == (int(drive.feature_stamps[-1]), Word.GOOD, ())


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("extrinsics inverted", Word.CONTRADICTION),
        ("left and right exchanged", Word.CONTRADICTION),
        ("ids mixed", Word.CONTRADICTION),
        ("velocity x 2", Word.CONTRADICTION),
        ("no features for 5 s", Word.DOUBTFUL),
        ("no features from the middle on", Word.DOUBTFUL),
    ],
)
def test_what_is_wrong_is_named_first(drive: Drive, name: str, word: Word) -> None:
    disturbance = DISTURBANCES[name]
    judged = verdict(disturbance.change(drive))
    assert judged.word is word
    assert disturbance.named in judged.reasons[0]


def test_sliding_tracks_show_in_what_is_rejected_and_cost_little() -> None:
    simulated = simulate(steps=160, landmarks=900, seed=3)
    sliding = DISTURBANCES["half of the tracks slide"].change(simulated.drive)
    T = se3.inverse(simulated.T_world_body[0]) @ simulated.T_world_body
    errors, rejected = {}, {}
    for name, drive, estimator in (
        ("as it is", simulated.drive, "robocentric"),
        ("sliding", sliding, "robocentric"),
        ("unseen", sliding, "dead_reckoning"),
    ):
        solved = solve(drive, estimator=estimator)
        off = solved.trajectory.positions - T[:, :3, 3]
        errors[name] = np.sqrt(np.mean(np.sum(off**2, axis=1)))
        rejected[name] = np.sum(solved.steps["rejected"])
    assert rejected["sliding"] > 4 * rejected["as it is"]
    # So it is good, and may be called so.
    assert errors["sliding"] < 0.5 * errors["unseen"]


@pytest.mark.parametrize(("rejected", "is_told"), [(10, False), (12, True)])
def test_ids_are_named_among_what_may_be_wrong_where_much_is_rejected(
    drive: Drive, rejected: int, is_told: bool
) -> None:
    reasons = judged_of(drive, [(100 - rejected, rejected)] * 100).reasons
    told = f"{rejected}% of the observations were rejected: tracks, their ids, twists and "
    assert [reason.startswith(told) for reason in reasons] == [True] * is_told


def test_images_that_contradict_themselves_are_no_test_of_the_twists(drive: Drive) -> None:
    both = DISTURBANCES["left and right exchanged"].change(
        DISTURBANCES["extrinsics inverted"].change(drive)
    )
    assert not any("would fit" in reason for reason in verdict(both).reasons)


def test_what_is_said_of_images_holds_for_any_filter(drive: Drive) -> None:
    wrong = DISTURBANCES["extrinsics inverted"].change(drive)
    said = {
        verdict(wrong, estimator=name).reasons[0] for name in ("robocentric", "dead_reckoning")
    }
    assert len(said) == 1


def test_an_estimate_that_vision_rarely_corrects_is_doubtful(drive: Drive) -> None:
    judged = verdict(drive, estimator="dead_reckoning")
    assert judged.word is Word.DOUBTFUL
    assert judged.reasons == (
        "vision corrected the estimate in 0 of 160 frames only: most of its motion is dead "
        "reckoning's",
    )


@pytest.mark.parametrize(("seconds", "is_told"), [(2.5, False), (3.5, True)])
def test_a_gap_is_told_with_its_length_and_its_place(
    drive: Drive, seconds: float, is_told: bool
) -> None:
    reasons = verdict(Outage("features", 0.25, seconds).applied(drive)).reasons
    assert bool(reasons) is is_told
    for reason in reasons:
        assert "vision was missing for 3." in reason
        assert "3.9 s after the start" in reason


def test_frames_that_see_nothing_are_a_gap_as_frames_that_are_missing(drive: Drive) -> None:
    keep = np.repeat(np.arange(drive.steps) < 100, np.diff(drive.offsets))
    counts = np.where(np.arange(drive.steps) < 100, np.diff(drive.offsets), 0)
    blind = dataclasses.replace(
        drive,
        offsets=np.concatenate([[0], np.cumsum(counts)]),
        ids=drive.ids[keep],
        pixels=drive.pixels[keep],
    )
    assert "vision was missing for 6.0 s" in verdict(blind).reasons[0]


def test_a_stretch_that_vision_contradicts_is_told_with_its_length_and_its_place(
    drive: Drive,
) -> None:
    rng, pixels = np.random.default_rng(5), drive.pixels.copy()
    frame = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    wrong = (frame >= 60) & (frame < 100) & (rng.random(len(frame)) < 0.75)
    pixels[wrong] += rng.uniform(-60.0, 60.0, (np.count_nonzero(wrong), 4))
    solution = solve(dataclasses.replace(drive, pixels=pixels))
    used, rejected = solution.steps["used"][60:100], solution.steps["rejected"][60:100]
    assert np.count_nonzero(used) > 5
    assert np.mean(rejected > used) > 0.9
    assert solution.verdict is not None
    assert solution.verdict.word is Word.DOUBTFUL
    assert any(
        reason.startswith("vision was missing or contradicted for 4.")
        and " s, 5.9 s after the start" in reason
        for reason in solution.verdict.reasons
    )


@pytest.mark.parametrize(("rejected", "is_told"), [(9, False), (10, True)])
def test_a_frame_is_a_witness_unless_most_of_it_was_rejected(
    drive: Drive, rejected: int, is_told: bool
) -> None:
    # So much is used that the share of the whole drive is none to speak of.
    outcomes = [(1000, 0)] * 200 + [(10, rejected)] * 40 + [(1000, 0)] * 60
    reasons = judged_of(drive, outcomes).reasons
    assert bool(reasons) is is_told
    for reason in reasons:
        assert reason.startswith("vision was missing or contradicted for 4.1 s, 19.9 s after")


def test_what_is_wrong_at_present_begins_and_ends(drive: Drive) -> None:
    holed = Outage("features", 0.3, 5.0).applied(drive)
    begin, end = Outage("features", 0.3, 5.0).span(drive)
    slam, reckoning = Slam(RobocentricSettings()), DeadReckoning(PredictionSettings())
    slam.set_camera(holed.camera)
    words, stamp = [], 0
    for prediction, _ in feed(holed, reckoning, slam):
        stamp = prediction.stamp if prediction else stamp
        present = slam.present_verdict()
        if present is not None:
            words.append((stamp, present.word))
    wrong = [stamp for stamp, word in words if word is not Word.GOOD]
    assert wrong
    assert begin + 2 * SECOND < wrong[0] < begin + 4 * SECOND
    assert end - SECOND < wrong[-1] < end + SECOND // 5
    final = slam.verdict()
    assert final is not None
    assert final.word is Word.DOUBTFUL


def test_the_same_steps_give_the_same_verdict_however_often_it_was_asked_for(
    drive: Drive,
) -> None:
    wrong = DISTURBANCES["velocity x 2"].change(drive)
    slam, reckoning = Slam(RobocentricSettings()), DeadReckoning(PredictionSettings())
    slam.set_camera(wrong.camera)
    for k, _ in enumerate(feed(wrong, reckoning, slam)):
        if k % 50 == 0:
            slam.verdict()
            slam.present_verdict()
    assert slam.verdict() == verdict(wrong)


def test_there_is_no_verdict_without_a_step_and_a_new_one_after_a_reset(drive: Drive) -> None:
    slam, reckoning = Slam(RobocentricSettings()), DeadReckoning(PredictionSettings())
    slam.set_camera(drive.camera)
    assert slam.verdict() is None
    assert slam.present_verdict() is None
    for _ in feed(drive, reckoning, slam):
        pass
    before = slam.verdict()
    slam.reset()
    assert slam.verdict() is None
    assert slam.previous_verdict == before
