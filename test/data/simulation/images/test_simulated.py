# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated images are those of their settings, and can be tracked."""

import itertools

import cv2
import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.images.simulated import simulate_images
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

QUICK = {"scale": 0.25, "seconds": 0.5, "scene": "room"}


@pytest.fixture(scope="module")
def quick():
    return simulate_images(**QUICK)


def test_equal_seeds_draw_equal_images_and_others_do_not(quick):
    again, other = simulate_images(**QUICK), simulate_images(**QUICK, seed=1)
    both = zip(quick.frames(), again.frames(), strict=True)
    for (stamp, left, right), frame in itertools.islice(both, 3):
        assert stamp == frame[0]
        assert np.array_equal(left, frame[1])
        assert np.array_equal(right, frame[2])
    assert np.array_equal(quick.imu.angular_velocities, again.imu.angular_velocities)
    assert np.array_equal(quick.twists, again.twists)
    assert (other.frame(0)[0] != quick.frame(0)[0]).mean() > 0.5


def test_a_frame_is_the_same_in_any_order(quick):
    later = quick.frame(3)[0]
    quick.frame(1)
    assert np.array_equal(quick.frame(3)[0], later)
    assert not np.array_equal(quick.frame(3)[1], later)


def test_frames_come_at_their_rate_for_the_whole_time():
    simulated = simulate_images(**{**QUICK, "rate": 30.0, "seconds": 1.0})
    assert len(simulated) == 31
    gaps = np.diff(simulated.stamps)
    assert np.abs(gaps - NANOSECONDS / 30).max() <= 1
    assert simulated.imu.stamps[0] == simulated.stamps[0]
    assert simulated.imu.stamps[-1] >= simulated.stamps[-1]
    left, right = simulated.frame(30)
    assert left.shape == right.shape == (120, 188)
    assert left.dtype == np.uint8


def test_twists_lead_from_frame_to_frame_but_for_noise_and_bias():
    exact = {"velocity_noise_std": 0.0, "angular_velocity_noise_std": 0.0}
    bias = (0.01, -0.02, 0.03)
    simulated = simulate_images(**QUICK, **exact, gyro_bias=bias)
    poses = simulated.trajectory.T_world_body
    tau = np.diff(simulated.stamps)[:, None] / NANOSECONDS
    steps = se3.exp((simulated.twists[1:] - [0, 0, 0, *bias]) * tau)
    assert poses[:-1] @ steps == pytest.approx(poses[1:], abs=1e-9)
    noisy = simulate_images(**QUICK, gyro_bias=bias).twists - simulated.twists
    assert 0.03 < noisy[:, :3].std() < 0.3
    assert 0.003 < noisy[:, 3:].std() < 0.03


@pytest.mark.parametrize("scene", ["street", "room"])
def test_a_recorded_motion_is_followed(scene):
    seconds = 0.1 * np.arange(30)
    poses = se3.exp(np.outer(seconds, [2.0, 0.1, 0.0, 0.02, 0.01, 0.2]))
    poses[:, :3, 3] += [100.0, -50.0, 3.0]
    stamps = np.rint((5.0 + seconds) * NANOSECONDS).astype(np.int64)
    along = Trajectory.from_matrices(stamps, poses)
    simulated = simulate_images(
        scene=scene, scale=0.25, rate=10.0, seconds=9.0, moving_objects=0, along=along
    )
    assert np.array_equal(simulated.stamps, stamps)
    assert simulated.trajectory.T_world_body == pytest.approx(poses, abs=1e-9)
    assert simulated.frame(10)[0].std() > 10


def test_a_recorded_motion_of_one_frame_is_refused():
    poses = np.tile(np.eye(4), (3, 1, 1))
    along = Trajectory.from_matrices(np.array([0, 20_000_000, 40_000_000]), poses)
    with pytest.raises(VislamError, match=r"along: .* 0\.04 s has no two frames at 20 Hz"):
        simulate_images(along=along)
    one = Trajectory.from_matrices(np.array([0]), poses[:1])
    with pytest.raises(VislamError, match="along: a motion of one pose"):
        simulate_images(along=one)


@pytest.mark.parametrize("values", [{"scene": "moon"}, {"rate": 0.0}, {"exposure_time": 1.0}])
def test_what_cannot_be_is_refused_by_name(values):
    with pytest.raises(VislamError, match=next(iter(values))):
        simulate_images(**values)


def test_a_long_exposure_blurs_what_moves():
    sharp, blurred = (
        simulate_images(**QUICK, image_noise=0.0, exposure_time=t).frame(5)[0] for t in (0, 0.05)
    )
    edges = [np.abs(cv2.Laplacian(image, cv2.CV_32F)).mean() for image in (sharp, blurred)]
    assert edges[1] < 0.8 * edges[0]
    assert sharp.mean() == pytest.approx(blurred.mean(), rel=0.05)


def test_the_exposure_changes_where_it_is_asked_to(quick):
    assert np.all(quick.exposures == 1)
    changing = simulate_images(**{**QUICK, "seconds": 4.0, "rate": 5.0}, exposure_changes=True)
    bright, dark = np.argmax(changing.exposures), np.argmin(changing.exposures)
    assert changing.frame(int(bright))[0].mean() > 2 * changing.frame(int(dark))[0].mean()


@pytest.mark.parametrize("scene", ["street", "room"])
def test_a_rectified_pair_has_no_vertical_disparity_and_a_raw_one_has(scene):
    pairs = {}
    for rectified in (True, False):
        simulated = simulate_images(scene=scene, seconds=0.2, scale=0.5, rectified=rectified)
        left, right = simulated.frame(0)
        points, matched = tracked(left, right)
        pairs[rectified] = np.abs((matched - points)[:, 1])
        assert simulated.rig.left.distortion_model == ("" if rectified else "plumb_bob")
    assert np.median(pairs[True]) < 0.15
    assert np.median(pairs[False]) > 0.5


def tracked(first, second):
    """Points of one image that are found in another, forth and back."""
    points = cv2.goodFeaturesToTrack(first, 300, 0.005, 7, blockSize=5)
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, points, None)
    back, found_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None)
    good = (found & found_back).ravel() > 0
    good &= np.linalg.norm(back - points, axis=2).ravel() < 0.3
    return points[good, 0], there[good, 0]


@pytest.mark.parametrize("scene", ["street", "room"])
def test_tracks_of_an_ordinary_tracker_agree_with_the_truth(scene):
    simulated = simulate_images(scene=scene, seconds=1.0, rectified=True, moving_objects=0)
    K = simulated.rig.left.K
    surfaces, images = simulated.scene.at(0.0), [simulated.frame(k)[0] for k in (8, 9)]
    before, after = simulated.trajectory.T_world_body[8:10] @ simulated.rig.T_body_left
    points, found = tracked(*images)
    assert len(points) > 150
    width, height = simulated.rig.left.image_size
    cells = np.unique((points // [width / 6, height / 3]).astype(int) @ [1, 10])
    assert len(cells) >= 15

    depths = depths_of(points, K, before, surfaces)
    rays = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(K).T
    T = se3.inverse(after) @ before
    moved = (rays * depths[:, None]) @ T[:3, :3].T + T[:3, 3]
    projected = moved @ K.T
    off = found - projected[:, :2] / projected[:, 2:]
    assert np.median(np.linalg.norm(off, axis=1)) < 0.2
    assert np.abs(np.median(off, axis=0)).max() < 0.05
    assert np.linalg.norm(np.median(found - points, axis=0)) > 0.3


def depths_of(points, K, T_world_camera, surfaces):
    """Depths of the nearest surfaces at pixels, by a ray for each of them."""
    T = se3.inverse(T_world_camera)
    rays = np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(K).T
    nearest = np.full(len(points), 1e9)
    finite = surfaces.layers < 2
    for corners in surfaces.corners[finite] @ T[:3, :3].T + T[:3, 3]:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        with np.errstate(divide="ignore"):
            depth = (normal @ corners[0]) / (rays @ normal)
        # The texture's face is the side that its corners go round clockwise.
        inside = (depth > 0.05) & (rays @ normal > 0)
        for a, b in itertools.pairwise([*corners, corners[0]]):
            edge = np.cross(normal, b - a)
            inside &= (rays * depth[:, None] - a) @ edge >= 0
        nearest = np.where(inside, np.minimum(nearest, depth), nearest)
    return nearest
