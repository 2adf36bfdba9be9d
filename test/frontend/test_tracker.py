# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from frontend.rendered_world import Rectangle, Shot, stereo_view
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.errors import VislamError
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import StereoTracker, Tracked

Array = NDArray[np.float64]
SETTINGS = TrackerSettings(max_features=80)


def rotation(before: Shot, now: Shot) -> Array:
    return (se3.inverse(now.T_world_camera) @ before.T_world_camera)[:3, :3]


def tracked(
    camera: StereoCamera, shots: Sequence[Shot], *, gyroscope: bool = True
) -> list[Tracked]:
    tracker = StereoTracker(camera, shots[0].left.shape[::-1], SETTINGS)
    result = []
    for k, shot in enumerate(shots):
        R = rotation(shots[k - 1], shot) if k and gyroscope else None
        result.append(tracker.track(shot.left, shot.right, R))
    return result


def errors(camera: StereoCamera, shots: Sequence[Shot], frames: Sequence[Tracked]) -> Array:
    """Age, and errors of u_left, v_left and of the disparity over the stated noise, (n, 4).

    A point is where it was first seen, at its true depth.
    """
    first: dict[int, tuple[int, Array]] = {}
    rows = []
    for k, (shot, frame) in enumerate(zip(shots, frames, strict=True)):
        columns, lines = np.rint(frame.pixels[:, :2]).astype(int).T
        disparities = camera.fx_baseline / shot.depth[lines, columns]
        for i, track in enumerate(frame.ids.tolist()):
            u_left, v_left, u_right, _ = frame.pixels[i].tolist()
            seen = np.array([u_left, u_left - disparities[i], v_left])
            begun, y = first.setdefault(track, (k, seen))
            T = se3.inverse(shot.T_world_camera) @ shots[begun].T_world_camera
            true = camera.warp(y, T)
            off = np.array([u_left - true[0], v_left - true[2], u_left - u_right - disparities[i]])
            rows.append([k - begun, *(off / frame.noise[i])])
    return np.array(rows)


def spread(values: NDArray[np.floating[Any]]) -> float:
    """Return the standard deviation, if it were not for a few wild ones."""
    return 1.4826 * float(np.median(np.abs(values)))


def test_points_live_long_and_stay_where_they_are(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    frames = tracked(camera, walk)
    assert min(len(frame.ids) for frame in frames) > 0.8 * SETTINGS.max_features
    off = errors(camera, walk, frames)
    assert np.mean(off[:, 0] >= 5) > 0.15
    followed = off[off[:, 0] > 0]
    # A tenth is more than five standard deviations off where patches slide along.
    assert np.mean(np.abs(followed[:, 1:3]).max(axis=1) > 5) < 0.05
    young, old = followed[followed[:, 0] == 1], followed[followed[:, 0] >= 5]
    assert spread(old[:, 1:3]) < 2 * spread(young[:, 1:3])


def test_the_stated_noise_is_that_of_the_pixels(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    off = errors(camera, walk, tracked(camera, walk))
    followed = off[off[:, 0] > 0]
    assert 0.4 < spread(followed[:, 1:3]) < 1.5
    # Two rows make a disparity.
    assert 0.3 < spread(off[:, 3]) / np.sqrt(2) < 1.5


def test_the_stated_noise_grows_with_the_images(
    camera: StereoCamera, world: list[Rectangle]
) -> None:
    medians = []
    for noise in (1.0, 8.0):
        rng = np.random.default_rng(5)
        shots = [stereo_view(world, camera, (376, 240), np.eye(4), rng, noise) for _ in range(2)]
        medians.append(np.median(tracked(camera, shots)[1].noise))
    assert medians[1] > 2 * medians[0]


def test_ids_increase_and_are_never_given_again(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    frames = tracked(camera, walk)
    seen: set[int] = set()
    before: set[int] = set()
    for frame in frames:
        assert frame.ids.dtype == np.uint32
        assert frame.pixels.dtype == frame.noise.dtype == np.float32
        assert np.all(np.diff(frame.ids.astype(np.int64)) > 0)
        now = set(frame.ids.tolist())
        assert not (now - before) & seen
        seen |= now
        before = now


def test_when_all_ids_are_used_up_they_begin_again(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    plain, wrapping = (StereoTracker(camera, walk[0].left.shape[::-1], SETTINGS) for _ in "ab")
    offset = 2**32 - SETTINGS.max_features // 2
    wrapping._next_id = offset
    for shot in walk:
        expected, found = (each.track(shot.left, shot.right) for each in (plain, wrapping))
        ids = (expected.ids.astype(np.int64) + offset) % 2**32
        order = np.argsort(ids)
        assert found.ids.tolist() == ids[order].tolist()
        assert found.pixels.tobytes() == expected.pixels[order].tobytes()
        assert found.noise.tobytes() == expected.noise[order].tobytes()
    assert found.ids.min() < offset <= found.ids.max(), "both before and after"


def test_ids_of_points_that_are_followed_are_not_given_again(camera: StereoCamera) -> None:
    tracker = StereoTracker(camera, (64, 48), SETTINGS)
    tracker._next_id = 2**32 - 2
    taken = np.array([2**32 - 1, 0, 2], dtype=np.uint32)
    assert tracker._new_ids(3, taken).tolist() == [2**32 - 2, 1, 3]
    assert tracker._new_ids(0, taken).tolist() == []
    assert tracker._new_ids(1, taken).tolist() == [4]


def test_without_a_gyroscope_the_last_motion_is_the_guess(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    frames = tracked(camera, walk, gyroscope=False)
    off = errors(camera, walk, frames)
    assert np.mean(off[:, 0] >= 5) > 0.15


def test_a_standing_camera_keeps_its_points(camera: StereoCamera, stand: Sequence[Shot]) -> None:
    frames = tracked(camera, stand)
    kept = np.isin(frames[0].ids, frames[-1].ids)
    assert kept.mean() > 0.9
    assert not any(frame.repeated for frame in frames)


def test_a_repeated_pair_says_nothing_and_the_tracks_go_on(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    tracker = StereoTracker(camera, (376, 240), SETTINGS)
    first = tracker.track(walk[0].left, walk[0].right)
    R = rotation(walk[0], walk[1])
    # The gyroscope goes on while the camera repeats itself: half of the turn to each.
    half = se3.exp_rotation(se3.log_rotation(R) / 2)
    again = tracker.track(walk[0].left.copy(), walk[0].right.copy(), half)
    assert again.repeated
    assert again.ids.shape == (0,)
    assert again.pixels.shape == (0, 4)
    then = tracker.track(walk[1].left, walk[1].right, half)
    plain = tracked(camera, walk[:2])[1]
    assert_array_equal(then.ids, plain.ids)
    assert np.isin(first.ids, then.ids).mean() > 0.7
    np.testing.assert_allclose(then.pixels, plain.pixels, atol=0.05)


def test_one_image_that_is_repeated_makes_no_pair(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    tracker = StereoTracker(camera, (376, 240), SETTINGS)
    tracker.track(walk[0].left, walk[0].right)
    assert tracker.track(walk[1].left, walk[0].right).repeated
    assert tracker.track(walk[0].left, walk[1].right).repeated


@pytest.mark.parametrize("level", [0, 255])
def test_a_dark_or_white_frame_ends_tracks_and_new_ones_begin(
    camera: StereoCamera, walk: Sequence[Shot], level: int
) -> None:
    tracker = StereoTracker(camera, (376, 240), SETTINGS)
    before = tracker.track(walk[0].left, walk[0].right)
    blind = np.full_like(walk[0].left, level)
    for _ in range(2):
        nothing = tracker.track(blind, blind)
        assert not len(nothing.ids)
        assert not nothing.repeated
    after = tracker.track(walk[1].left, walk[1].right)
    assert len(after.ids) > 40
    assert after.ids.min() > before.ids.max()


def test_noise_alone_gives_next_to_nothing(camera: StereoCamera) -> None:
    rng = np.random.default_rng(8)
    tracker = StereoTracker(camera, (376, 240), SETTINGS)
    for _ in range(3):
        left, right = rng.integers(0, 30, (2, 240, 376), dtype=np.uint8)
        assert len(tracker.track(left, right).ids) < 0.05 * SETTINGS.max_features


def test_exposure_may_change_between_frames_and_between_cameras(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    plain = tracked(camera, walk[:3])
    changed = []
    for k, shot in enumerate(walk[:3]):
        bright = np.clip(shot.left * (0.7 + 0.3 * k) + 5, 0, 255).astype(np.uint8)
        dim = np.clip(shot.right * 0.6 + 20, 0, 255).astype(np.uint8)
        changed.append(dataclasses.replace(shot, left=bright, right=dim))
    frames = tracked(camera, changed)
    lasted = [np.isin(run[0].ids, run[2].ids).mean() for run in (plain, frames)]
    assert lasted[1] > 0.7 * lasted[0]
    off = errors(camera, walk[:3], frames)
    assert spread(off[off[:, 0] > 0][:, 1:3]) < 1.5


def test_what_moves_by_itself_is_left_out(camera: StereoCamera, world: list[Rectangle]) -> None:
    rng = np.random.default_rng(6)
    inside = []
    for speed in (0.0, 0.06):
        shots = []
        for k in range(4):
            # A board two metres ahead that slides to the right, while the camera moves ahead.
            middle = np.array([-0.3 + speed * k, 0.0, 2.0])
            board = Rectangle(
                middle, np.array([0.6, 0, 0]), np.array([0, 0.5, 0]), world[0].texture[:256, :256]
            )
            pose = se3.pose_matrix([0, 0, 0.03 * k], [0, 0, 0, 1])
            shots.append(stereo_view([*world, board], camera, (376, 240), pose, rng))
        frame = tracked(camera, shots)[-1]
        old = frame.ids < 80
        disparities = frame.pixels[:, 0] - frame.pixels[:, 2]
        inside.append(int(np.sum(disparities[old] > camera.fx_baseline / 2.2)))
    assert inside[0] >= 10
    assert inside[1] < 0.2 * inside[0]


def test_far_points_are_kept(camera: StereoCamera, world: list[Rectangle]) -> None:
    far = Rectangle(
        np.array([0, 0, 5000.0]),
        np.array([5000.0, 0, 0]),
        np.array([0, 5000.0, 0]),
        world[0].texture,
    )
    rng = np.random.default_rng(7)
    shots = [stereo_view([far], camera, (376, 240), np.eye(4), rng) for _ in range(2)]
    frame = tracked(camera, shots)[1]
    disparities = frame.pixels[:, 0] - frame.pixels[:, 2]
    assert len(frame.ids) > 40
    assert spread(disparities) < 0.2
    # The noise has two sides.
    assert 0.1 < np.mean(disparities < 0) < 0.9


def test_an_image_of_another_size_or_type_is_told(camera: StereoCamera) -> None:
    tracker = StereoTracker(camera, (376, 240), SETTINGS)
    right = np.zeros((240, 376), np.uint8)
    with pytest.raises(VislamError, match=r"left image: is \(240, 375\)"):
        tracker.track(right[:, 1:], right)
    with pytest.raises(VislamError, match=r"right image.*float64"):
        tracker.track(right, right.astype(float))


def test_images_may_be_read_only_and_parts_of_others(
    camera: StereoCamera, walk: Sequence[Shot]
) -> None:
    wide = [np.concatenate([image, image], axis=1) for image in (walk[0].left, walk[0].right)]
    parts = [image[:, :376] for image in wide]
    for image in parts:
        image.flags.writeable = False
    frame = StereoTracker(camera, (376, 240), SETTINGS).track(parts[0], parts[1])
    assert_array_equal(frame.pixels, tracked(camera, walk[:1])[0].pixels)


@pytest.mark.parametrize("size", [(1, 1), (16, 400), (17, 17), (40, 30)])
def test_small_images_are_no_trouble(camera: StereoCamera, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(9)
    tracker = StereoTracker(camera, size)
    for _ in range(2):
        left = rng.integers(0, 255, size[::-1], dtype=np.uint8)
        frame = tracker.track(left, left)
        assert frame.pixels.shape == (len(frame.ids), 4)


def test_the_same_images_give_the_same_tracks(camera: StereoCamera, walk: Sequence[Shot]) -> None:
    for one, other in zip(tracked(camera, walk[:4]), tracked(camera, walk[:4]), strict=True):
        assert_array_equal(one.ids, other.ids)
        assert_array_equal(one.pixels, other.pixels)
        assert_array_equal(one.noise, other.noise)
