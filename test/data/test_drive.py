# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive of a tracker's own frames, and what is wrong with such frames."""

from typing import Any

import numpy as np
import pytest
from numerics import CAMERA

from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.errors import VislamError

STAMPS = [10.0, 10.1, 10.2]
IDS = [[7, 3], [], [7]]
PIXELS = [[[50, 20, 40, 20], [60, 30, 55, 30]], [], [[51, 20, 40, 21]]]
TWISTS = np.arange(18.0).reshape(3, 6)


def drive_of(**changes: Any) -> Drive:
    arguments: dict[str, Any] = {
        "stamps": STAMPS,
        "ids": IDS,
        "pixels": PIXELS,
        "twists": TWISTS,
        "camera": CAMERA,
    }
    return Drive.from_tracks(**{**arguments, **changes})


def test_frames_are_held_one_after_the_other_and_ids_in_order() -> None:
    drive = drive_of(name="mine")
    assert (drive.name, drive.steps, drive.tracks) == ("mine", 3, 2)
    assert drive.feature_stamps.tolist() == [10_000_000_000, 10_100_000_000, 10_200_000_000]
    assert drive.twist_stamps.tolist() == drive.feature_stamps.tolist()
    ids, pixels = drive.frame(0)
    assert ids.tolist() == [3, 7]
    assert pixels.tolist() == [PIXELS[0][1], PIXELS[0][0]]
    assert [len(drive.frame(k)[0]) for k in range(3)] == [2, 0, 1]
    assert (ids.dtype.name, pixels.dtype.name) == ("uint32", "float32")
    assert drive.image_size == (61, 31)


def test_tracks_of_two_frames_in_turn_are_held_against_each_other() -> None:
    first, second = np.arange(8.0).reshape(2, 4), np.arange(8.0, 20.0).reshape(3, 4)
    drive = drive_of(ids=[[3, 7], [9, 7, 1], [7]], pixels=[first, second, second[:1]])
    ids, before, after = drive.followed(0)
    assert (ids.tolist(), before.tolist(), after.tolist()) == (
        [7],
        [[4, 5, 6, 7]],
        [[12, 13, 14, 15]],
    )


def test_some_frames_are_kept_with_all_that_is_said_of_them() -> None:
    drive = drive_of(noise=[[0.1, 0.2], [], [0.3]])
    left = drive.with_frames(np.array([False, True, True]))
    assert left.feature_stamps.tolist() == drive.feature_stamps[1:].tolist()
    assert left.twist_stamps.tolist() == drive.twist_stamps.tolist()
    for k in range(2):
        for ours, own in zip(left.frame(k), drive.frame(k + 1), strict=True):
            np.testing.assert_array_equal(ours, own)
        np.testing.assert_array_equal(left.noise_of(k), drive.noise_of(k + 1))


def test_the_frames_of_a_drive_make_the_same_drive() -> None:
    drive = simulate(steps=10, landmarks=40).drive
    ids, pixels = zip(*map(drive.frame, range(drive.steps)), strict=True)
    again = Drive.from_tracks(drive.feature_stamps, ids, pixels, drive.twists, drive.camera)
    for name in ("twist_stamps", "twists", "feature_stamps", "offsets", "ids", "pixels"):
        np.testing.assert_array_equal(getattr(again, name), getattr(drive, name))
    assert (again.camera, again.image_size) == (drive.camera, drive.image_size)


def test_integers_are_nanoseconds_and_twists_may_have_stamps_of_their_own() -> None:
    drive = drive_of(
        stamps=np.array([0, 100_000_000, 200_000_000]),
        twists=np.zeros((21, 6)),
        twist_stamps=0.01 * np.arange(21),
    )
    assert drive.feature_stamps.tolist() == [0, 100_000_000, 200_000_000]
    assert drive.twist_stamps[[0, 1, -1]].tolist() == [0, 10_000_000, 200_000_000]


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        ([0, 1, 2], "are 1 nanoseconds apart.*meant to be floats"),
        ([0, 100, 200], "are 100 nanoseconds apart"),  # milliseconds
        ([0, 100_000, 200_000], "apart"),  # microseconds
        ([0.0, 1e8, 2e8], r"are 1e\+08 seconds apart.*meant to be integers"),
        ([0.0, 33.3, 66.6], "are 33.3 seconds apart"),
        ([1.7e18, 1.7e18 + 1e8, 1.7e18 + 2e8], "is no time in seconds"),
        ([0.0, float("nan"), 0.2], "is no time in seconds"),
        ([0.0, 0.1, 0.1], r"stamps\[2\]: 0.1 is negative or not later"),
        ([-0.1, 0.0, 0.1], r"stamps\[0\]: -0.1 is negative"),
        ([[0.0, 0.1, 0.2]], r"stamps: have shape \(1, 3\)"),
        (["a", "b", "c"], "stamps: have shape"),
        ([], r"stamps: have shape \(0,\)"),
    ],
)
def test_stamps_in_another_unit_are_told(stamps: Any, message: str) -> None:
    with pytest.raises(VislamError, match=message) as caught:
        drive_of(stamps=stamps)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", [8, 11], ids=["of a velocity", "of an angular velocity"])
def test_a_twist_with_a_nan_is_left_out_with_a_note(number: int) -> None:
    drive = drive_of(twists=np.where(number == TWISTS, np.nan, TWISTS))
    np.testing.assert_array_equal(drive.twists, TWISTS[[0, 2]])
    assert drive.twist_stamps.tolist() == [10_000_000_000, 10_200_000_000]
    assert drive.notes == (
        "Left out 1 of 3 samples of motion with a NaN, the first at 10.100000000 s.",
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ids": IDS[:2]}, "ids: 2 frames for 3 stamps"),
        ({"pixels": [*PIXELS, []]}, "pixels: 4 frames for 3 stamps"),
        ({"ids": [7, 3, 7]}, r"frame 0: has ids of shape \(\) and int"),
        ({"ids": [[7.5, 3.0], [], [7]]}, "frame 0: has ids of shape .2,. and float64"),
        ({"ids": [[7], [], [7]]}, r"frame 0: .* pixels of shape \(2, 4\)"),
        ({"ids": [[7, 7], [], [7]]}, "frame 0: has track 7 twice"),
        ({"ids": [[7, 3], [], [-1]]}, "frame 2: ids go from -1 to -1, not 32 bits"),
        ({"ids": [[7, 2**32], [], [1]]}, "frame 0: ids go from 7 to 4294967296"),
        (
            {"pixels": [*PIXELS[:2], [[np.nan, 20, 40, 21]]]},
            "frame 2: a pixel of track 7 is not finite",
        ),
        ({"twists": TWISTS[:2]}, r"twists: have shape \(2, 6\), not \(3, 6\)"),
        ({"twists": np.where(TWISTS == 8, np.inf, TWISTS)}, "twists: a velocity of inf m/s"),
        ({"twists": np.where(TWISTS % 6 == 5, np.nan, TWISTS)}, "3 of 3 angular velocities are"),
        ({"twist_stamps": [10.0, 10.1]}, r"twists: have shape \(3, 6\), not \(2, 6\)"),
        ({"twist_stamps": [0, 1, 2]}, "twist_stamps: are 1 nanoseconds apart"),
    ],
)
def test_what_is_wrong_with_frames_and_twists_is_told_in_a_line(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(VislamError, match=message) as caught:
        drive_of(**changes)
    assert "\n" not in str(caught.value)
