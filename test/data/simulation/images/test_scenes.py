# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The street leaves its way free and the room holds its motion; objects move."""

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.images.centre_line import CentreLine
from vislam_ros.data.simulation.images.motion import room_poses
from vislam_ros.data.simulation.images.room import room
from vislam_ros.data.simulation.images.street import BODY_HEIGHT, street
from vislam_ros.data.simulation.images.surfaces import Layer, SurfaceStack, box
from vislam_ros.data.simulation.images.texture import Texture
from vislam_ros.data.simulation.motion import drive_poses

SECONDS = 0.1 * np.arange(150)


def drive(kind):
    if kind == "curves":
        return drive_poses(len(SECONDS), 0.1, np.random.default_rng(2))
    poses = np.tile(np.eye(4), (len(SECONDS), 1, 1))
    if kind == "back and forth":
        yaw = np.where(SECONDS < 7.5, 0.0, np.pi)
        poses[:, :3, :3] = se3.exp_rotation(np.outer(yaw, [0, 0, 1]))
        poses[:, 0, 3] = 8 * np.minimum(SECONDS, 15 - SECONDS)
    return poses


@pytest.fixture(scope="module", params=["curves", "back and forth", "standing"])
def a_drive(request):
    poses = drive(request.param)
    return poses, street(poses, SECONDS, moving=2, rng=np.random.default_rng(0))


def test_nothing_that_stands_is_in_the_way(a_drive):
    poses, scene = a_drive
    solid = scene.still.layers == Layer.SOLID
    share = np.linspace(0, 1, 12)[:, None, None]
    corners = scene.still.corners[solid]
    # All four sides of each face, densely.
    edges = (1 - share) * corners[:, None] + share * np.roll(corners, -1, axis=1)[:, None]
    points = edges.reshape(-1, 3)
    for position in poses[::10, :3, 3]:
        near = np.abs(points[:, 2] - position[2]) < 3
        assert np.linalg.norm((points - position)[near, :2], axis=1).min() > 1.4


def test_the_road_lies_under_the_body_all_the_way(a_drive):
    poses, scene = a_drive
    floor = scene.still.corners[scene.still.layers == Layer.FLOOR]
    for position in poses[::10, :3, 3]:
        below = np.linalg.norm(floor.reshape(-1, 3)[:, :2] - position[:2], axis=1) < 14
        height = position[2] - floor.reshape(-1, 3)[below, 2]
        assert height.min() < BODY_HEIGHT + 0.3
        assert height.max() > BODY_HEIGHT - 0.3


def test_there_are_houses_and_cars_on_both_sides_and_a_backdrop(a_drive):
    _, scene = a_drive
    assert np.sum(scene.still.layers == Layer.BACKDROP) == 12
    assert np.sum(scene.still.layers == Layer.SOLID) > 40


def test_cars_move_and_one_of_them_stays_ahead():
    poses = drive("curves")
    scene = street(poses, SECONDS, moving=2, rng=np.random.default_rng(0))
    ahead, oncoming = scene.moving
    for k in range(0, len(SECONDS), 10):
        T = se3.inverse(poses[k]) @ ahead.pose(float(SECONDS[k]))
        assert 8 < np.linalg.norm(T[:3, 3]) < 26
        assert T[0, 3] > 5
    apart = [np.linalg.norm(poses[k, :3, 3] - oncoming.pose(SECONDS[k])[:3, 3]) for k in (0, 20)]
    assert apart[0] - apart[1] > 15
    before, after = scene.at(0.0), scene.at(1.0)
    moved = np.any(before.corners != after.corners, axis=(1, 2))
    assert moved.sum() == sum(len(each.surfaces.corners) for each in scene.moving)
    assert not moved[: len(scene.still.corners)].any()


def test_a_room_holds_the_motion():
    poses = room_poses(SECONDS, np.random.default_rng(1))
    poses[:, :3, 3] += [30.0, -4.0, 12.0]
    scene = room(poses, moving=1, rng=np.random.default_rng(0))
    low = scene.still.corners.min(axis=(0, 1))
    high = scene.still.corners.max(axis=(0, 1))
    assert np.all(poses[:, :3, 3].min(axis=0) - low > 1.2)
    assert np.all(high - poses[:, :3, 3].max(axis=0) > 1.2)
    assert np.any(scene.moving[0].pose(0.0) != scene.moving[0].pose(1.0))


def test_walls_of_a_room_are_seen_from_within():
    poses = room_poses(SECONDS, np.random.default_rng(1))
    scene = room(poses, moving=0, rng=np.random.default_rng(0))
    shell = scene.still.world_from_texels[:6]
    away = np.cross(shell[:, :, 0], shell[:, :, 1])
    offset = shell[:, :, 2] - poses[0, :3, 3]
    assert np.all(np.sum(away * offset, axis=1) > 0)


def test_faces_of_a_box_are_seen_from_outside():
    texture = Texture(np.zeros((64, 64)), 64)
    T = se3.exp([1.0, 2.0, 3.0, 0.2, -0.4, 1.0])
    stack = SurfaceStack.of(box([texture], T, (2.0, 1.0, 0.5)))
    centre = T[:3, :3] @ [0, 0, 0.25] + T[:3, 3]
    away = np.cross(stack.world_from_texels[:, :, 0], stack.world_from_texels[:, :, 1])
    assert np.all(np.sum(away * (stack.corners.mean(axis=1) - centre), axis=1) < 0)
    for face in stack.corners:
        local = (face - T[:3, 3]) @ T[:3, :3]
        assert np.abs(local / [1.0, 0.5, 0.5]).max() == pytest.approx(1)


def test_a_line_goes_on_straight_before_and_after_a_drive():
    poses = drive("curves")
    line = CentreLine(poses, body_height=1.0, before=12.0, after=24.0)
    assert line.ways[0] == pytest.approx(-12)
    end = line.place(line.ways[-1], 0.0)
    assert line.place(0.0, 0.0) == pytest.approx(poses[0, :3, 3] - [0, 0, 1.0])
    assert (line.place(-12.0, 2.0) - poses[0, :3, 3]) == pytest.approx([-12, 2, -1], abs=0.1)
    assert np.linalg.norm(end[:2] - poses[-1, :2, 3]) == pytest.approx(24, abs=6)
    pose = line.pose(5.0, 0.0, back=True)
    assert pose[:3, 0] @ line.pose(5.0, 0.0)[:3, 0] == pytest.approx(-1)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
