# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pickles of arrays are within the limits, and what is beyond them is refused unread."""

import io
import pickle
import struct
from typing import Any

import numpy as np
import pytest

from vislam_ros.data.datasets.arrays.pickle_limits import (
    MOST_OPCODES,
    MOST_SHARED_TUPLES,
    MOST_TUPLES,
    check_claims,
)
from vislam_ros.data.datasets.arrays.restricted_pickle import load_plain
from vislam_ros.errors import VislamError

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)


def check(data: bytes) -> int:
    return check_claims(io.BytesIO(data)).size


def shared_tuples(times: int) -> bytes:
    """A dict whose one key holds a tuple that is fetched from the memo so many times."""
    return b"\x80\x04}K\x01\x85\x94" + b"h\x00\x86" * times + b"K\x02s."


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_a_dataset_holds_is_within_the_limits(protocol: int) -> None:
    rng = np.random.default_rng(0)
    content: dict[str, Any] = {
        "features": rng.normal(size=(4, 300, 50)),
        "time_stamps": rng.normal(size=6000).tolist(),
        "v_t": rng.normal(size=(3, 6000)).tolist(),
        "scalars": [np.float64(x) for x in range(300)],
        "b": 2**63 - 1,
    }
    data = pickle.dumps(np.array(content, dtype=object), protocol=protocol)
    assert check(data + b"what comes after") == len(data) + 16


def test_the_file_stands_where_it_stood() -> None:
    stream = io.BytesIO(b"header" + pickle.dumps([1.0]))
    stream.seek(6)
    check_claims(stream)
    assert stream.tell() == 6


@pytest.mark.parametrize(
    ("data", "fits"),
    [
        (b"\x80\x04(" + (MOST_OPCODES - 4) * b"K\x01" + b"l.", True),
        (b"\x80\x04(" + (MOST_OPCODES - 3) * b"K\x01" + b"l.", False),
        (b"\x80\x04(" + MOST_TUPLES * b")" + b"l.", True),
        (b"\x80\x04(" + (MOST_TUPLES + 1) * b")" + b"l.", False),
        (shared_tuples(MOST_SHARED_TUPLES), True),
        (shared_tuples(MOST_SHARED_TUPLES + 1), False),
        (b"\x80\x04C\x03abc.", True),
        (b"\x80\x04C\x05abc.", False),
        (b"\x80\x04\x8a\x10" + 16 * b"\x01" + b".", True),
        (b"\x80\x04\x8a\x11" + 17 * b"\x01" + b".", False),
        (b"}r" + struct.pack("<I", 2) + b".", True),
        (b"}r" + struct.pack("<I", 3) + b".", False),
        (b"}p2\n.", True),
        (b"}p3\n.", False),
        (b"}2.", False),
        (b"}", False),
        (b"", False),
        (b"\xff", False),
    ],
)
def test_limits_hold_on_both_sides(data: bytes, fits: bool) -> None:
    if fits:
        assert check(data) == len(data)
    else:
        with pytest.raises(ValueError, match=r"\w"):
            check(data)


@pytest.mark.parametrize(
    ("call", "fits"),
    [
        (b"cbuiltins\nbytearray\nC\x03abc\x85R.", True),
        (b"cbuiltins\nbytearray\nK\x03\x85R.", False),
        (b"cbuiltins\nbytes\nJ\x00\x00\x00\x40\x85R.", False),
    ],
)
def test_bytes_are_made_of_bytes_and_not_of_numbers(call: bytes, fits: bool) -> None:
    stream = io.BytesIO(b"\x80\x04" + call)
    if fits:
        assert load_plain(stream, "drive.npy") == b"abc"
    else:
        with pytest.raises(VislamError, match="bytes of a claimed length"):
            load_plain(stream, "drive.npy")


@pytest.mark.parametrize(("times", "fits"), [(100, True), (9000, False)])
def test_copies_of_what_is_there_have_an_end(times: int, fits: bool) -> None:
    """Each call takes 22 bytes and makes 255 of them."""
    copy = b"cbuiltins\nbytearray\nh\x00\x85R"
    stream = io.BytesIO(b"\x80\x04(C\xff" + 255 * b"x" + b"\x94" + times * copy + b"l.")
    if fits:
        assert len(load_plain(stream, "drive.npy")) == times + 1
    else:
        with pytest.raises(VislamError, match="more copies than its bytes hold"):
            load_plain(stream, "drive.npy")
