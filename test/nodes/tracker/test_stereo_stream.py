# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs come out as the messages say, in whatever order the streams bring them."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vislam_ros.core.tracking.refusals import Refusal, Stream
from vislam_ros.data.images.stereo_images import Motion
from vislam_ros.nodes.settings import TrackerNodeSettings
from vislam_ros.nodes.tracker.stereo_stream import ReadyPair, StereoStream

LEFT, RIGHT, IMU, IMAGES = Stream.LEFT_IMAGE, Stream.RIGHT_IMAGE, Stream.IMU, Stream.IMAGES
START, PERIOD = 1_000_000_000_000, 50_000_000
STAMPS = [START + PERIOD * k for k in range(10)]
SAMPLES = [START - PERIOD + PERIOD // 10 * k for k in range(120)]
OMEGAS = np.random.default_rng(3).normal(size=(120, 3))
PIXELS = (np.zeros((2, 2), np.uint8), "mono8")

Refused = list[tuple[Stream, Refusal, int]]
Message = tuple[Stream, int]


@pytest.fixture
def refused() -> Refused:
    return []


@pytest.fixture
def make(refused: Refused) -> Callable[..., StereoStream]:
    def start(**settings: Any) -> StereoStream:
        changed = replace(TrackerNodeSettings(), **{"gyroscope": "required", **settings})
        stream = StereoStream(changed, lambda *what: refused.append(what))
        stream.is_open = True
        return stream

    return start


def sent(stream: StereoStream, messages: Iterable[Message]) -> list[ReadyPair]:
    ready: list[ReadyPair] = []
    for kind, stamp in messages:
        if kind is IMU:
            ready += stream.add_angular_velocity(stamp, OMEGAS[SAMPLES.index(stamp)])
        else:
            ready += stream.add_image(kind, stamp, PIXELS)
    return ready


def of(kind: Stream, stamps: Iterable[int]) -> list[Message]:
    return [(kind, stamp) for stamp in stamps]


IN_TIME = sorted(
    [*of(IMU, SAMPLES), *of(LEFT, STAMPS), *of(RIGHT, STAMPS)],
    key=lambda message: (message[1], message[0].value),
)


@pytest.mark.parametrize(
    "messages",
    [
        IN_TIME,
        [*of(LEFT, STAMPS), *of(RIGHT, STAMPS), *of(IMU, SAMPLES)],
        [*of(IMU, SAMPLES), *of(RIGHT, STAMPS), *of(LEFT, STAMPS)],
        [*of(RIGHT, STAMPS), *of(IMU, SAMPLES), *of(LEFT, STAMPS)],
    ],
)
def test_the_turns_are_those_of_the_motion_whatever_comes_first(
    make: Callable[..., StereoStream], refused: Refused, messages: list[Message]
) -> None:
    ready = sent(make(), messages)
    assert [pair.stamp for pair in ready] == STAMPS
    assert [pair.begins_pass for pair in ready] == [True] + [False] * 9
    motion = Motion.of_imu(np.array(SAMPLES), OMEGAS)
    assert ready[0].turn is None
    for before, pair in zip(STAMPS, ready[1:], strict=False):
        expected = motion.turn_between(before, pair.stamp)
        assert expected is not None
        assert pair.turn is not None
        assert pair.turn.tobytes() == expected.tobytes()
    assert not refused


def test_a_pair_waits_for_the_sample_that_reaches_it(make: Callable[..., StereoStream]) -> None:
    stream = make()
    images = [*of(LEFT, STAMPS[:3]), *of(RIGHT, STAMPS[:3])]
    assert [pair.stamp for pair in sent(stream, images)] == STAMPS[:1]
    short = [stamp for stamp in SAMPLES if stamp < STAMPS[1]]
    assert not sent(stream, of(IMU, short))
    assert stream.waiting == 2
    assert stream.refused_if_over.counts == {"images_no_prediction": 2}
    assert [pair.stamp for pair in sent(stream, of(IMU, [STAMPS[1]]))] == STAMPS[1:2]


def test_pairs_go_on_without_a_gyroscope_that_falls_silent_until_it_is_heard_again(
    make: Callable[..., StereoStream],
) -> None:
    stream = make(max_pending=3)
    sent(stream, of(IMU, SAMPLES[:2]))
    ready = sent(stream, [m for stamp in STAMPS[:5] for m in ((LEFT, stamp), (RIGHT, stamp))])
    assert [pair.stamp for pair in ready] == STAMPS[:5]
    assert all(pair.turn is None for pair in ready)
    assert stream.without_turn == 4
    again = [stamp for stamp in SAMPLES if STAMPS[4] <= stamp <= STAMPS[5]]
    sent(stream, of(IMU, again))
    (pair,) = sent(stream, [(LEFT, STAMPS[5]), (RIGHT, STAMPS[5])])
    assert pair.turn is not None
    assert not sent(stream, [(LEFT, STAMPS[6]), (RIGHT, STAMPS[6])])


def test_without_any_sample_nothing_waits_unless_the_gyroscope_is_required(
    make: Callable[..., StereoStream],
) -> None:
    images = [m for stamp in STAMPS for m in ((LEFT, stamp), (RIGHT, stamp))]
    assert len(sent(make(gyroscope="auto"), images)) == len(STAMPS)
    assert len(sent(make(), images)) == 1


def test_images_without_a_partner_are_refused(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    stream = make(gyroscope="auto")
    lefts = [stamp for stamp in STAMPS if stamp != STAMPS[3]]
    rights = [stamp for stamp in STAMPS if stamp != STAMPS[6]]
    ready = sent(stream, [*of(LEFT, lefts), *of(RIGHT, rights)])
    assert [pair.stamp for pair in ready] == [s for s in lefts if s in rights]
    assert refused == [
        (RIGHT, Refusal.UNPAIRED, STAMPS[3]),
        (LEFT, Refusal.UNPAIRED, STAMPS[6]),
    ]
    sent(stream, [(LEFT, STAMPS[-1] + PERIOD)])
    assert stream.refused_if_over.counts == {"left_image_unpaired": 1}


@pytest.mark.parametrize(("tolerance", "pairs"), [(0.0, 10), (0.02, 10), (0.019, 0)])
def test_stamps_within_the_tolerance_are_of_one_moment(
    make: Callable[..., StereoStream], tolerance: float, pairs: int
) -> None:
    stream = make(gyroscope="auto", stamp_tolerance=tolerance)
    late = [stamp + 20_000_000 for stamp in STAMPS]
    ready = sent(stream, [*of(LEFT, STAMPS), *of(RIGHT, late)])
    assert [pair.stamp for pair in ready] == STAMPS[:pairs]


def test_the_nearer_of_two_images_is_the_partner(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    stream = make(gyroscope="auto", stamp_tolerance=0.03)
    extra = sorted([*STAMPS, STAMPS[4] - 10_000_000])
    ready = sent(stream, [*of(LEFT, extra), *of(RIGHT, STAMPS)])
    assert [pair.stamp for pair in ready] == STAMPS
    assert refused == [(LEFT, Refusal.UNPAIRED, STAMPS[4] - 10_000_000)]


def test_a_bad_stamp_costs_its_own_image_and_its_partner(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    stream = make(gyroscope="auto")
    lefts = [*STAMPS[:5], STAMPS[5] + 3_600_000_000_000, *STAMPS[6:]]
    ready = sent(stream, [*of(LEFT, lefts), *of(RIGHT, STAMPS)])
    assert [pair.stamp for pair in ready] == [s for s in STAMPS if s != STAMPS[5]]
    assert (LEFT, Refusal.BAD_STAMP, lefts[5]) in refused
    assert (RIGHT, Refusal.UNPAIRED, STAMPS[5]) in refused


def test_a_loop_begins_a_pass_whose_first_pair_has_no_turn(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    # A pass must be longer than the jump back to its begin.
    stream = make(time_jump=0.1)
    ready = sent(stream, [*IN_TIME, *IN_TIME])
    assert [pair.stamp for pair in ready] == [*STAMPS, *STAMPS]
    assert [k for k, pair in enumerate(ready) if pair.begins_pass] == [0, 10]
    for first, second in zip(ready[:10], ready[10:], strict=True):
        assert (first.turn is None) == (second.turn is None)
        if first.turn is not None and second.turn is not None:
            assert first.turn.tobytes() == second.turn.tobytes()
    assert not refused


def test_until_the_cameras_are_known_the_newest_pairs_are_kept(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    stream = make(gyroscope="auto", max_pending=4)
    stream.is_open = False
    images = [m for stamp in STAMPS for m in ((LEFT, stamp), (RIGHT, stamp))]
    assert not sent(stream, images)
    assert refused == [(IMAGES, Refusal.NO_CAMERA, stamp) for stamp in STAMPS[:6]]
    assert stream.refused_if_over.counts == {"images_no_camera": 4}
    stream.is_open = True
    assert [pair.stamp for pair in stream.advance()] == STAMPS[6:]


def test_one_camera_that_is_silent_does_not_fill_the_memory(
    make: Callable[..., StereoStream], refused: Refused
) -> None:
    stream = make(max_pending=4)
    sent(stream, of(LEFT, STAMPS))
    assert refused == [(LEFT, Refusal.UNPAIRED, stamp) for stamp in STAMPS[:6]]
