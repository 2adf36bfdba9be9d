# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from benchmark.battery.rooms import (
    FLIGHT,
    TAKE_OFF,
    WALK,
    RoomSettings,
    room_poses,
    simulate_in_room,
)
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import pixels_of
from vislam_ros.data.drive import Drive

EACH = pytest.mark.parametrize(
    "settings", [WALK, FLIGHT, TAKE_OFF], ids=["walk", "flight", "take-off"]
)
RATE = 20


def simulated(settings: RoomSettings, sliding_share: float = 0.0, noise: float = 0.0) -> Drive:
    return simulate_in_room(
        settings,
        features=15,
        rate=RATE,
        seconds=20.0,
        sliding_share=sliding_share,
        rng=np.random.default_rng(3),
        pixel_noise_std=noise,
    )


def reprojection_errors(drive: Drive) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Pixels (n, 4) by which tracks are off the point of their first observation, and ids (n,)."""
    assert drive.ground_truth is not None
    T_world_camera = drive.ground_truth.T_world_body @ drive.camera.T_body_camera
    frames = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    _, first, track = np.unique(drive.ids, return_index=True, return_inverse=True)
    pixels = drive.pixels.astype(np.float64)
    points = drive.camera.triangulate(pixels[first][:, [0, 2, 1]])
    T_now_then = se3.inverse(T_world_camera[frames]) @ T_world_camera[frames[first][track]]
    rotated = np.einsum("nij,nj->ni", T_now_then[:, :3, :3], points[track])
    expected = pixels_of(drive.camera.project(rotated + T_now_then[:, :3, 3]))
    return pixels - expected, drive.ids


@EACH
def test_without_noise_every_track_is_a_point_that_stands_still(settings: RoomSettings) -> None:
    errors, _ = reprojection_errors(simulated(settings))
    assert_allclose(errors, 0.0, atol=0.02)


@EACH
def test_pixels_are_as_noisy_as_told_and_lie_in_the_images(settings: RoomSettings) -> None:
    noisy, plain = simulated(settings, noise=0.7), simulated(settings)
    first = noisy.pixels[:15] - plain.pixels[:15]
    assert first.std() == pytest.approx(0.7, rel=0.3)
    assert plain.pixels.min() >= 0.0
    assert np.all(plain.pixels <= [751.0, 479.0, 751.0, 479.0])


def test_a_take_off_stands_and_then_is_a_flight() -> None:
    t = np.arange(400) / RATE
    flight, take_off = (room_poses(s, t, np.random.default_rng(5)) for s in (FLIGHT, TAKE_OFF))
    rests = round(TAKE_OFF.rest * RATE) + 1
    assert np.ptp(take_off[:rests], axis=0).max() == 0.0
    # It is as fast as the flight after half a second, and a quarter of a second late by then.
    half, late = RATE // 2, RATE // 4
    assert_allclose(
        take_off[rests - 1 + half :], flight[half - late : -rests + 1 - late], atol=1e-9
    )


def test_the_told_share_of_tracks_slides() -> None:
    errors, ids = reprojection_errors(simulated(WALK, sliding_share=0.4))
    tracks, seen = np.unique(ids, return_counts=True)
    sliding = np.isin(tracks, np.unique(ids[np.abs(errors[:, 0]) > 0.3]))
    assert np.mean(sliding[seen > 3]) == pytest.approx(0.4, abs=0.08)
    # Left and right alike, so that the depth does not tell.
    assert_allclose(errors[:, 0], errors[:, 2], atol=0.02)


@pytest.mark.parametrize("settings", [WALK, FLIGHT], ids=["walk", "flight"])
def test_a_body_keeps_within_its_limits_and_its_room(settings: RoomSettings) -> None:
    t = np.arange(0.0, 60.0, 1 / RATE)
    for seed in range(5):
        T = room_poses(settings, t, np.random.default_rng(seed))
        twists = se3.log(se3.inverse(T[:-1]) @ T[1:]) * RATE
        fastest = np.linalg.norm(twists.reshape(-1, 2, 3), axis=2).max(axis=0)
        # They reach their limits, which leave out the tilt.
        assert_allclose(fastest, [settings.speed, settings.turn_rate], rtol=0.05)
        assert np.all(np.abs(T[:, :3, 3]) < np.array(settings.size) / 2)


@EACH
def test_frames_hold_as_many_features_as_told(settings: RoomSettings) -> None:
    counts = np.diff(simulated(settings).offsets)
    assert counts.mean() == pytest.approx(15, rel=0.02)
    assert counts.max() == 15


def test_a_drive_is_made_of_its_seed_alone() -> None:
    assert simulated(WALK).pixels.tobytes() == simulated(WALK).pixels.tobytes()
