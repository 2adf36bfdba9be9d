# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages are read before they are due, in order, within bounds, and no thread stays behind."""

import threading
from collections.abc import Iterator
from contextlib import closing

import pytest

from vislam_ros.data.bags.bag_messages import BagConnection
from vislam_ros.nodes.player.read_ahead import Message, read_ahead

CONNECTION = BagConnection("/a", "b", 1, None)
SECONDS = 10.0


def messages(sizes: list[int]) -> list[Message]:
    return [(CONNECTION, k, bytes(size)) for k, size in enumerate(sizes)]


def test_all_messages_come_in_their_order() -> None:
    given = messages([3] * 1000)
    assert list(read_ahead(given, most_bytes=10)) == given


def test_the_next_messages_are_read_while_one_is_used() -> None:
    third_is_read = threading.Event()

    def told() -> Iterator[Message]:
        for k, message in enumerate(messages([1] * 3)):
            if k == 2:
                third_is_read.set()
            yield message

    with closing(read_ahead(told())) as ahead:
        next(ahead)
        assert third_is_read.wait(SECONDS)


def test_no_more_is_kept_than_allowed_but_for_one_message() -> None:
    taken = 0
    most_ahead = 0

    def told() -> Iterator[Message]:
        nonlocal most_ahead
        for k, message in enumerate(messages([100] * 50)):
            most_ahead = max(most_ahead, k - taken)
            yield message

    for _ in read_ahead(told(), most_bytes=250):
        taken += 1
    # Three are kept, one more is read and waits, and one may be under way to its user.
    assert taken == 50
    assert 1 <= most_ahead <= 5


def test_a_message_above_the_bound_passes() -> None:
    given = messages([1000, 1000])
    assert list(read_ahead(given, most_bytes=10)) == given


def test_an_error_comes_after_the_messages_before_it() -> None:
    def told() -> Iterator[Message]:
        yield from messages([1, 1])
        raise ValueError("damaged")

    ahead = read_ahead(told())
    assert [next(ahead)[1], next(ahead)[1]] == [0, 1]
    with pytest.raises(ValueError, match="damaged"):
        next(ahead)


@pytest.mark.parametrize("taken", [0, 1, 2])
def test_the_thread_ends_with_whoever_leaves(taken: int) -> None:
    before = threading.active_count()
    with closing(read_ahead(messages([1] * 100), most_bytes=2)) as ahead:
        for _ in range(taken):
            next(ahead)
    assert threading.active_count() == before
