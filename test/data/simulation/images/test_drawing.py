# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Surfaces are drawn where the camera projects them, and hide each other as they should."""

import cv2
import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera
from vislam_ros.data.simulation.images.drawing import Pinhole
from vislam_ros.data.simulation.images.lens import LensView
from vislam_ros.data.simulation.images.rigs import room_rig, street_rig
from vislam_ros.data.simulation.images.surfaces import Layer, SurfaceStack, rectangle
from vislam_ros.data.simulation.images.texture import Texture, fractal

K = np.array([[300.0, 0.0, 160.3], [0.0, 305.0, 119.1], [0.0, 0.0, 1.0]])
SIZE = (320, 240)
PER_METRE = 320.0
BACKDROP_TURN = se3.exp([0.0, 0.0, 0.0, 0.05, -0.1, 0.02])


def plain(grey, top_left, size, *, layer=Layer.SOLID):
    """A rectangle in front of a camera at the origin that looks along z."""
    texture = Texture(np.full((64, 64), grey), 64.0)
    return rectangle(texture, top_left, [size, 0, 0], [0, size, 0], layer=layer)


def board(T_camera_board):
    """A board of smooth waves; points on it in the camera, metres, and the grey of each."""
    v, u = np.indices((256, 320)) + 0.5
    texture = Texture(_waves(u, v), PER_METRE)
    R, p = T_camera_board[:3, :3], T_camera_board[:3, 3]
    size = np.array(texture.size) / PER_METRE
    corner = R @ [-size[0] / 2, -size[1] / 2, 0] + p
    surface = rectangle(texture, corner, R[:, 0] * size[0], R[:, 1] * size[1])
    v, u = np.mgrid[16:240:4, 16:304:4].reshape(2, -1)
    points = corner + (np.outer(u, R[:, 0]) + np.outer(v, R[:, 1])) / PER_METRE
    return SurfaceStack.of([surface]), points, _waves(u, v)


def _waves(u, v):
    return 128 + 100 * np.sin(2 * np.pi * u / 40 + 0.3) * np.sin(2 * np.pi * v / 32)


def shifts(image, pixels, greys):
    """How far off an image is, (m, 2) pixels, in patches about some of its pixels."""
    maps = pixels.astype(np.float32).T.reshape(2, -1, 1)
    values, gx, gy = (
        cv2.remap(x, maps[0], maps[1], cv2.INTER_CUBIC)[:, 0]
        for x in (
            image.astype(np.float32),
            cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32),
            cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32),
        )
    )
    inside = np.all((pixels > 8) & (pixels < np.array(SIZE) - 9), axis=1)
    cells = (pixels // 40).astype(int) @ [1, 100]
    found = []
    for cell in np.unique(cells[inside]):
        here = inside & (cells == cell)
        if here.sum() > 60:
            gradients = np.column_stack([gx, gy])[here]
            found.append(np.linalg.lstsq(gradients, greys[here] - values[here], rcond=None)[0])
    assert len(found) > 8
    return np.array(found)


def small_image(picture):
    """What a sensor would see: each pixel the mean of its small ones."""
    return cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)


def pose(translation, rotation):
    """Pose at a place, turned by a rotation vector."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = se3.exp_rotation(rotation), translation
    return T


POSES = [
    pose([0.0, 0.0, 1.6], [0.0, 0.0, 0.0]),
    pose([0.05, 0.0, 1.7], [0.5, -0.3, 0.2]),
    pose([-0.05, 0.03, 1.6], [-0.2, 0.8, -0.3]),
]


@pytest.mark.parametrize("T_camera_board", POSES)
@pytest.mark.parametrize("oversampling", [1.0, 1.6, 2.0])
def test_points_stand_where_they_are_projected(T_camera_board, oversampling):
    surfaces, points, greys = board(T_camera_board)
    image = small_image(Pinhole(K, SIZE, oversampling).draw(np.eye(4), surfaces, 128))
    pixels = points @ K.T
    off = shifts(image, pixels[:, :2] / pixels[:, 2:], greys)
    assert np.abs(off).max() < 0.05
    assert np.abs(off.mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("T_camera_board", POSES)
def test_points_stand_where_a_lens_puts_them(T_camera_board):
    surfaces, points, greys = board(T_camera_board)
    D = np.array([-0.28, 0.07, 0.0005, -0.0003])
    image = LensView(RawCamera(SIZE, K, "plumb_bob", D)).draw(np.eye(4), surfaces, 128)
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    undistorted = points @ K.T
    assert np.linalg.norm(undistorted[:, :2] / undistorted[:, 2:] - pixels, axis=1).max() > 2
    off = shifts(image, pixels, greys)
    assert np.abs(off).max() < 0.05
    assert np.abs(off.mean(axis=0)).max() < 0.01


def test_a_raw_image_without_a_lens_shows_what_an_ideal_one_does():
    surfaces, _, _ = board(POSES[1])
    raw = LensView(RawCamera(SIZE, K, "", np.empty(0))).draw(np.eye(4), surfaces, 128)
    ideal = small_image(Pinhole(K, SIZE).draw(np.eye(4), surfaces, 128))
    softer = cv2.GaussianBlur(ideal, (0, 0), 0.5)
    assert np.abs(raw.astype(int) - softer).mean() < 0.5


@pytest.mark.parametrize("rig", [room_rig(), street_rig()])
def test_the_lens_of_a_rig_shows_something_everywhere(rig):
    wall = plain(200, [-40.0, -40.0, 5.0], 80.0)
    for camera in (rig.left, rig.right):
        image = LensView(camera).draw(np.eye(4), SurfaceStack.of([wall]), 0)
        assert image.shape == camera.image_size[::-1]
        assert image.min() == 200


def test_the_disparity_of_a_plane_is_that_of_its_distance():
    picture = 128 + 40 * fractal((512, 512), 16, np.random.default_rng(0))
    wall = rectangle(Texture(picture, 100.0), [-2.5, -2.5, 4.0], [5.12, 0, 0], [0, 5.12, 0])
    surfaces, baseline = SurfaceStack.of([wall]), 0.11
    T_world_right = np.eye(4)
    T_world_right[0, 3] = baseline
    camera = Pinhole(K, SIZE)
    left, right = (small_image(camera.draw(T, surfaces)) for T in (np.eye(4), T_world_right))
    crop = np.s_[20:220, 60:260]
    (u, v), _ = cv2.phaseCorrelate(left[crop].astype(float), right[crop].astype(float))
    assert u == pytest.approx(-K[0, 0] * baseline / 4.0, abs=0.05)
    assert v == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("nearest_first", [True, False])
def test_what_is_nearer_hides_what_is_farther(nearest_first):
    near, far = plain(50, [-0.2, -0.2, 1.0], 0.4), plain(150, [-1.0, -1.0, 2.0], 2.0)
    order = [near, far] if nearest_first else [far, near]
    image = small_image(Pinhole(K, SIZE).draw(np.eye(4), SurfaceStack.of(order), 255))
    assert image[119, 160] == 50
    assert image[119, 90] == 150
    assert image[119, 2] == 255


def test_surfaces_that_cross_are_cut_where_they_meet():
    texture = Texture(np.full((64, 64), 40.0), 64.0)
    slant = rectangle(texture, [-1.0, -1.0, 1.0], [2.0, 0.0, 2.0], [0.0, 2.0, 0.0])
    wall = plain(180, [-2.0, -2.0, 2.0], 4.0)
    image = small_image(Pinhole(K, SIZE).draw(np.eye(4), SurfaceStack.of([wall, slant]), 0))
    # They meet where the slant, z = 2 + x, is as deep as the wall: at x = 0.
    row = image[119].astype(int)
    assert set(row[100:160]) == {40}
    assert set(row[162:300]) == {180}


def test_the_back_of_a_surface_and_what_is_behind_the_camera_are_not_seen():
    texture = Texture(np.full((64, 64), 40.0), 64.0)
    back = rectangle(texture, [1.0, -1.0, 2.0], [-2.0, 0.0, 0.0], [0.0, 2.0, 0.0])
    behind = plain(40, [-1.0, -1.0, -2.0], 2.0)
    image = Pinhole(K, SIZE).draw(np.eye(4), SurfaceStack.of([back, behind]), 7)
    assert np.all(image == 7)


def test_a_floor_under_the_camera_is_drawn_to_the_horizon_and_to_the_lower_border():
    texture = Texture(np.full((64, 64), 90.0), 64.0)
    floor = rectangle(texture, [-1000.0, 1.0, 400.0], [2000.0, 0, 0], [0, 0, -420.0])
    image = small_image(Pinhole(K, SIZE).draw(np.eye(4), SurfaceStack.of([floor]), 200))
    horizon = K[1, 2] + K[1, 1] / 400
    assert np.all(image[int(horizon) + 3 :] == 90)
    assert np.all(image[: int(horizon) - 1] == 200)


def test_pieces_of_a_floor_lie_over_each_other_in_their_order():
    first, second = (plain(grey, [-1.0, -1.0, 2.0], 2.0, layer=Layer.FLOOR) for grey in (60, 160))
    camera = Pinhole(K, SIZE)
    for pieces in ([first, second], [second, first]):
        image = camera.draw(np.eye(4), SurfaceStack.of(pieces), 0)
        drawn = int(image[240, 320])
        assert drawn == (160 if pieces[-1] is second else 60)


def test_a_backdrop_turns_with_the_camera_and_does_not_come_nearer():
    picture = 128 + 40 * fractal((512, 512), 64, np.random.default_rng(0))
    backdrop = rectangle(
        Texture(picture, 256.0), [-1, -1, 1], [2, 0, 0], [0, 2, 0], layer=Layer.BACKDROP
    )
    wall = plain(5, [-0.1, -0.1, 50.0], 0.2)
    surfaces, camera = SurfaceStack.of([backdrop, wall]), Pinhole(K, SIZE)
    T = np.eye(4)
    here = camera.draw(T, surfaces)
    T[:3, 3] = [30.0, -5.0, 20.0]
    assert (camera.draw(T, surfaces) != here).mean() < 1e-3
    assert (camera.draw(BACKDROP_TURN, surfaces) != here).mean() > 0.5
    assert here[238:240, 320:322].max() == 5


def test_what_is_too_fine_for_the_image_is_seen_as_its_mean():
    columns = np.arange(1024) % 2
    texture = Texture(np.tile(np.where(columns, 200.0, 0.0), (1024, 1)), 256.0)
    far = rectangle(texture, [-4.0, -4.0, 40.0], [8.0, 0, 0], [0, 8.0, 0])
    image = small_image(Pinhole(K, SIZE).draw(np.eye(4), SurfaceStack.of([far]), 100))
    patch = image[100:138, 140:180]
    assert patch.std() < 2
    assert patch.mean() == pytest.approx(100, abs=2)
