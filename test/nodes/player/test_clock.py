# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The player's schedule: absolute, and obedient at once."""

import threading
from typing import Any
from unittest.mock import patch

import pytest

from vislam_ros.nodes.player.clock import PlaybackClock

SECOND = 1_000_000_000
WAIT = 20.0


class FakeTime:
    """Wall time that passes only when somebody waits."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def make_clock(rate: float, **options: Any) -> tuple[PlaybackClock, FakeTime]:
    """Make a clock whose waits take no time; each oversleeps by 3 ms, as real ones do."""
    wall = FakeTime()
    clock = PlaybackClock(rate, now=wall, **options)

    def wait(timeout: float | None = None) -> bool:
        wall.now += timeout + 0.003
        return False

    clock.condition.wait = wait  # type: ignore[method-assign]
    return clock, wall


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_lateness_does_not_add_up(rate: float) -> None:
    clock, wall = make_clock(rate)
    clock.start(7 * SECOND)
    for k in range(1000):
        stamp = 7 * SECOND + k * SECOND // 10
        assert clock.wait(stamp)
        clock.sent(stamp, ends_step=True)
        assert 0.0 <= wall.now - (100.0 + 0.1 * k / rate) < 0.0031


def test_at_rate_0_everything_is_due() -> None:
    clock, wall = make_clock(0.0)
    clock.start(0)
    assert clock.wait(10**18)
    assert wall.now == 100.0


def test_the_time_of_a_pause_is_left_out() -> None:
    clock, wall = make_clock(2.0)
    clock.start(0)
    wall.now += 1.0
    clock.pause()
    assert clock.paused
    assert clock.position() == 2 * SECOND
    wall.now += 50.0
    assert clock.position() == 2 * SECOND
    assert clock.seconds_paused() == 50.0
    clock.resume()
    assert clock.position() == 2 * SECOND
    assert clock.wait(4 * SECOND)
    assert wall.now == pytest.approx(152.0, abs=0.01)
    assert clock.seconds_paused() == 50.0


def test_the_time_in_which_the_process_stood_still_is_left_out() -> None:
    clock, wall = make_clock(2.0)
    clock.start(0)
    wall.now += 1.0
    assert clock.position() == 2 * SECOND
    wall.now += 50.0  # Ctrl-Z and fg
    assert clock.position() == 2 * SECOND
    assert clock.wait(4 * SECOND)
    assert wall.now == pytest.approx(152.0, abs=0.02)
    assert clock.seconds_paused() == 50.0


def test_after_steps_the_rest_keeps_its_distance() -> None:
    clock, wall = make_clock(1.0, paused=True)
    clock.start(0)
    for stamp in (0, SECOND):
        clock.step()
        assert clock.wait(stamp)
        clock.sent(stamp, ends_step=True)
    wall.now += 10.0
    clock.resume()
    resumed = wall.now
    assert clock.wait(3 * SECOND)
    assert wall.now - resumed == pytest.approx(2.0, abs=0.01)


def test_a_step_lets_through_all_up_to_its_end() -> None:
    clock, _ = make_clock(1.0)
    clock.start(0)
    clock.step()
    for stamp, ends_step in ((5 * SECOND, False), (6 * SECOND, False), (7 * SECOND, True)):
        assert clock.wait(stamp)
        clock.sent(stamp, ends_step=ends_step)
    with patch.object(clock.condition, "wait", lambda _: clock.interrupt()):  # it waits again
        assert not clock.wait(8 * SECOND)


@pytest.mark.parametrize("wake", ["resume", "step", "interrupt"])
def test_a_waiting_thread_obeys_at_once(wake: str) -> None:
    clock = PlaybackClock(1.0, paused=True)
    clock.start(0)
    answers = []
    waiting = threading.Thread(target=lambda: answers.append(clock.wait(0)))
    waiting.start()
    getattr(clock, wake)()
    waiting.join(WAIT)
    assert answers == [wake != "interrupt"]


def test_an_interrupt_ends_a_wait_for_a_condition() -> None:
    clock = PlaybackClock(1.0)
    waiting = threading.Thread(target=clock.wait_for, args=(lambda: False, 1000.0))
    waiting.start()
    clock.interrupt()
    waiting.join(WAIT)
    assert not waiting.is_alive()
