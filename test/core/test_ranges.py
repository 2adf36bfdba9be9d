# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Numbers of the world have ranges, and what lies outside is told with the range that is meant."""

import numpy as np
import pytest

from vislam_ros.core import ranges
from vislam_ros.core.ranges import Range
from vislam_ros.core.tracking.refusals import (
    Refusal,
    RefusedMessage,
    check_features,
    check_pose,
    check_twist,
)
from vislam_ros.errors import VislamError

EVERY = [value for value in vars(ranges).values() if isinstance(value, Range)]
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("meant", EVERY, ids=lambda meant: meant.what)
def test_both_ends_belong_to_a_range_and_nothing_beyond_them(meant: Range) -> None:
    assert meant.complaint([meant.low, meant.high]) is None
    for beyond in (np.nextafter(meant.low, -np.inf), np.nextafter(meant.high, np.inf), np.nan):
        complaint = meant.complaint([meant.high, beyond])
        assert complaint is not None
        for word in (meant.what, meant.unit, f"{meant.low:g}", f"{meant.high:g}"):
            assert word in complaint
    with pytest.raises(VislamError, match=f"^a.npz: K: {meant.what}"):
        meant.require(np.inf, "a.npz: K")


@pytest.mark.parametrize("value", [1e3, -1e3, 1e30])
@pytest.mark.parametrize("axis", range(6))
def test_a_twist_is_refused_where_nothing_moves_so_fast(value: float, axis: int) -> None:
    twist = np.zeros(6)
    twist[axis] = value
    if abs(value) <= 1e3:
        check_twist(twist)
        return
    with pytest.raises(RefusedMessage, match=r"from -1000 to 1000") as caught:
        check_twist(twist)
    assert caught.value.refusal is Refusal.ABSURD


@pytest.mark.parametrize(("value", "fits"), [(1e9, True), (1.1e9, False), (1e300, False)])
def test_a_pose_is_refused_where_nothing_comes_to(value: float, fits: bool) -> None:
    position = np.array([0.0, value, 0.0])
    if fits:
        check_pose(position, IDENTITY)
        return
    with pytest.raises(RefusedMessage, match="a coordinate of") as caught:
        check_pose(position, IDENTITY)
    assert caught.value.refusal is Refusal.ABSURD


def test_a_quaternion_of_huge_numbers_is_no_rotation() -> None:
    with np.errstate(over="ignore"), pytest.raises(RefusedMessage) as caught:
        check_pose(np.zeros(3), np.full(4, 1e200))
    assert caught.value.refusal is Refusal.NOT_A_ROTATION


@pytest.mark.parametrize(("value", "fits"), [(1e6, True), (1.1e6, False), (-1e30, False)])
def test_a_frame_is_refused_for_a_pixel_that_no_camera_has(value: float, fits: bool) -> None:
    pixels = np.array([[1.0, 2.0, 0.5, value]], dtype=np.float32)
    if fits:
        check_features(np.array([3], dtype=np.uint32), pixels)
        return
    with pytest.raises(RefusedMessage, match="a pixel of") as caught:
        check_features(np.array([3], dtype=np.uint32), pixels)
    assert caught.value.refusal is Refusal.ABSURD
