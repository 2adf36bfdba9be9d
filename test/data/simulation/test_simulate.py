# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive is what its settings say, looks like the real ones and survives its file."""

import dataclasses

import numpy as np
import pytest

from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import settings_from_dict
from vislam_ros.data.datasets import npz
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.motion import drive_poses
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.trajectory import Trajectory, read_tum
from vislam_ros.errors import SettingsError, VislamError

SMALL = SimulationSettings(steps=80, landmarks=300)
FROZEN = dataclasses.replace(SMALL, frozen_share=0.15)
EXACT = SimulationSettings(
    steps=80,
    landmarks=300,
    pixel_noise_std=0.0,
    velocity_noise_std=0.0,
    angular_velocity_noise_std=0.0,
    gyro_bias=(0.0, 0.0, 0.0),
    outlier_share=0.0,
)


@pytest.fixture(scope="module")
def demo():
    return simulate(SimulationSettings())


def frames_of_tracks(drive):
    """First and last frame and number of observations of each id."""
    steps = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    order = np.lexsort((steps, drive.ids))
    _, first, count = np.unique(drive.ids[order], return_index=True, return_counts=True)
    return steps[order][first], steps[order][first + count - 1], count


def assert_same_drive(a, b):
    for field in dataclasses.fields(a):
        if field.name not in ("name", "notes", "ground_truth"):
            np.testing.assert_equal(getattr(a, field.name), getattr(b, field.name))
    for field in dataclasses.fields(a.ground_truth):
        np.testing.assert_array_equal(
            getattr(a.ground_truth, field.name), getattr(b.ground_truth, field.name)
        )


def test_the_default_looks_like_a_real_drive(demo):
    drive = demo.drive
    disparity = drive.pixels[:, 0] - drive.pixels[:, 2]
    assert drive.steps == 600
    assert 5.5 < np.median(disparity) < 8  # 6.65 on drive 03
    assert 0.02 < np.mean(disparity < 1.3) < 0.1  # a twentieth
    assert 0.0 < np.mean(disparity <= 0) < 0.05
    assert 50 < np.mean(np.diff(drive.offsets)) < 80
    assert np.diff(drive.offsets).min() > 20
    assert 12 < len(drive.ids) / drive.tracks < 19


def test_the_default_makes_dead_reckoning_drift(demo):
    T = np.eye(4)
    tau = np.diff(demo.drive.twist_stamps) * 1e-9
    for step in tau[:, None] * demo.drive.twists[1:]:
        T = T @ se3.exp(step)
    assert np.linalg.norm(T[:3, 3] - demo.T_world_body[-1, :3, 3]) > 5.0


def test_the_car_turns_climbs_and_stands_still(demo):
    speed = demo.true_twists[:, 0]
    assert speed.max() > 8
    assert np.sum(speed < 1e-6) > 20
    np.testing.assert_allclose(demo.true_twists[speed == 0], 0, atol=1e-9)
    yaw = np.unwrap(np.arctan2(demo.T_world_body[:, 1, 0], demo.T_world_body[:, 0, 0]))
    assert np.ptp(yaw) > 1
    assert np.ptp(demo.T_world_body[:, 2, 3]) > 1
    # Cars do not slip: velocity is forward but for the weave of roll, pitch and the steps' chords.
    assert np.abs(demo.true_twists[:, 1:3]).max() < 0.5


def test_a_rough_road_changes_the_twist_from_step_to_step_as_on_kitti(demo):
    change = np.diff(demo.true_twists, axis=0)
    std = change.std(axis=0)
    # Measured on five drives of KITTI and KITTI-360, see shared/data/README.md.
    assert 0.08 < std[0] < 0.25
    assert np.all((std[1:3] > 0.02) & (std[1:3] < 0.1))
    assert np.all((std[3:5] > 0.01) & (std[3:5] < 0.03))
    assert 0.007 < std[5] < 0.02
    # Speed changes smoothly; sideways, up and in its turn rates a car shakes.
    following = np.sum(change[1:] * change[:-1], axis=0) / np.sum(change**2, axis=0)
    assert following[0] > 0.5
    assert np.all(np.abs(following[1:5]) < 0.4)


def test_a_drive_starts_at_the_origin_on_rigid_poses():
    T = drive_poses(300, 0.1, np.random.default_rng(3))
    np.testing.assert_array_equal(T[0], np.eye(4))
    R = T[:, :3, :3]
    np.testing.assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (300, 1, 1)), atol=1e-12
    )


def test_a_drive_goes_along_a_recorded_motion_from_where_that_begins():
    recorded = simulate(dataclasses.replace(EXACT, seed=5)).drive.ground_truth
    later = Trajectory(recorded.stamps[20:], recorded.positions[20:], recorded.quaternions[20:])
    simulated = simulate(dataclasses.replace(EXACT, steps=50), later)
    np.testing.assert_allclose(simulated.drive.feature_stamps, later.stamps[:50], atol=200)
    T = recorded.T_world_body
    np.testing.assert_allclose(
        simulated.T_world_body, se3.inverse(T[20]) @ T[20:70], rtol=0, atol=1e-12
    )
    errors, _, _ = residuals(simulated, 0)
    assert np.abs(errors).max() < 1e-3


def test_a_recorded_motion_that_ends_too_early_is_refused():
    recorded = simulate(dataclasses.replace(EXACT, steps=30, landmarks=30)).drive.ground_truth
    with pytest.raises(VislamError, match="30 poses has no 80 steps"):
        simulate(EXACT, recorded)


@pytest.mark.parametrize("settings", [SMALL, FROZEN], ids=["smooth", "frozen"])
def test_ids_are_numbered_by_first_appearance_and_tracks_have_no_gaps(settings):
    drive = simulate(settings).drive
    first, last, count = frames_of_tracks(drive)
    assert drive.tracks == settings.landmarks
    np.testing.assert_array_equal(np.unique(drive.ids), np.arange(settings.landmarks))
    assert np.all(np.diff(first) >= 0)
    np.testing.assert_array_equal(last - first + 1, count)
    for k in range(drive.steps):
        assert np.all(np.diff(drive.frame(k)[0].astype(int)) > 0)


def test_equal_seeds_give_equal_drives_and_others_do_not():
    a, b = simulate(FROZEN), simulate(FROZEN)
    assert_same_drive(a.drive, b.drive)
    other = simulate(dataclasses.replace(FROZEN, seed=1))
    assert not np.array_equal(a.drive.twists, other.drive.twists)


def test_twists_are_exact_without_noise():
    simulated = simulate(EXACT)
    tau = np.diff(simulated.drive.twist_stamps) * 1e-9
    T = [np.eye(4)]
    for step in tau[:, None] * simulated.drive.twists[1:]:
        T.append(T[-1] @ se3.exp(step))
    np.testing.assert_allclose(T, simulated.T_world_body, atol=1e-9)


def test_twist_noise_and_bias_are_as_set():
    settings = dataclasses.replace(
        SMALL,
        steps=2000,
        velocity_noise_std=0.3,
        angular_velocity_noise_std=0.02,
        gyro_bias=(0.01, -0.02, 0.03),
    )
    simulated = simulate(settings)
    error = simulated.drive.twists - simulated.true_twists
    np.testing.assert_allclose(error.std(axis=0), [0.3] * 3 + [0.02] * 3, rtol=0.1)
    np.testing.assert_allclose(error.mean(axis=0)[3:], settings.gyro_bias, atol=0.002)


def residuals(simulated, generation):
    """Pixels minus the projected true landmarks, for given generations (n,) of the rows."""
    drive, landmarks = simulated.drive, simulated.landmarks
    key = landmarks.ids.astype(np.int64) * 1000 + landmarks.generations
    row = np.searchsorted(key, drive.ids.astype(np.int64) * 1000 + generation)
    steps = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    T_camera_world = drive.camera.T_camera_body @ se3.inverse(simulated.T_world_body)
    points = landmarks.positions[row]
    T = T_camera_world[steps]
    camera_points = (T[:, :3, :3] @ points[..., None])[..., 0] + T[:, :3, 3]
    y = drive.camera.project(camera_points)
    return drive.pixels - y[:, [0, 2, 1, 2]], steps, landmarks.sliding[row]


def test_pixels_are_projections_with_the_noise_that_was_set():
    exact, _, _ = residuals(simulate(EXACT), 0)
    assert np.abs(exact).max() < 1e-4
    noisy, _, sliding = residuals(simulate(dataclasses.replace(SMALL, pixel_noise_std=0.7)), 0)
    np.testing.assert_allclose(noisy[~sliding].std(axis=0), 0.7, rtol=0.05)


def test_the_offset_of_a_disparity_stays_for_the_life_of_its_track():
    drive = simulate(dataclasses.replace(EXACT, disparity_offset_std=0.6)).drive
    same = simulate(EXACT).drive
    np.testing.assert_array_equal(drive.ids, same.ids)
    np.testing.assert_array_equal(drive.pixels[:, [0, 1, 3]], same.pixels[:, [0, 1, 3]])
    offset = drive.pixels[:, 2] - same.pixels[:, 2]
    ids, first = np.unique(drive.ids, return_index=True)
    np.testing.assert_allclose(offset, offset[first][np.searchsorted(ids, drive.ids)], atol=1e-3)
    np.testing.assert_allclose(offset[first].std(), 0.6, rtol=0.15)


def test_the_share_of_sliding_tracks_is_as_set():
    simulated = simulate(dataclasses.replace(EXACT, landmarks=1000, outlier_share=0.2))
    assert 0.15 < simulated.landmarks.sliding.mean() < 0.25
    error, steps, sliding = residuals(simulated, 0)
    first, _, _ = frames_of_tracks(simulated.drive)
    age = steps - first[simulated.drive.ids]
    assert np.abs(error[~sliding]).max() < 1e-3
    assert np.abs(error[age == 0]).max() < 1e-3
    assert np.median(np.linalg.norm(error[sliding & (age == 3)][:, :2], axis=1)) > 3


def test_frozen_steps_are_as_the_real_ones():
    simulated = simulate(FROZEN)
    drive, frozen = simulated.drive, simulated.frozen
    assert np.isclose(frozen.mean(), 0.15, atol=0.03)
    assert not frozen[0]
    assert not np.any(frozen[1:] & frozen[:-1])
    first, _, _ = frames_of_tracks(drive)
    assert np.all(frozen[np.unique(first)[1:]])
    for k in range(1, drive.steps):
        (before_ids, before), (ids, pixels) = drive.frame(k - 1), drive.frame(k)
        _, rows_before, rows = np.intersect1d(before_ids, ids, return_indices=True)
        repeated = np.all(before[rows_before] == pixels[rows], axis=1)
        assert np.all(repeated == frozen[k])


def test_after_a_frozen_step_an_id_is_another_point_at_the_stale_pixel():
    simulated = simulate(dataclasses.replace(EXACT, frozen_share=0.15))
    drive = simulated.drive
    first, _, _ = frames_of_tracks(drive)
    steps = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    frozen_so_far = np.cumsum(simulated.frozen)
    generation = frozen_so_far[steps] - frozen_so_far[first[drive.ids]]
    assert generation.max() > 1
    error, _, _ = residuals(simulated, generation)
    copied = simulated.frozen[steps] & (generation > 0)
    assert np.abs(error[~copied]).max() < 1e-3
    # At the frozen step itself the left pixel is exact and the disparity nearly so.
    assert np.abs(error[copied][:, [0, 1, 3]]).max() < 1e-3
    disparity = drive.pixels[copied][:, 0] - drive.pixels[copied][:, 2]
    assert 0.01 < np.std(error[copied][:, 2] / disparity) < 0.03
    # Its point is not where the last generation's was.
    moved, _, _ = residuals(simulated, np.maximum(generation - 1, 0))
    assert np.median(np.linalg.norm(moved[copied][:, :2], axis=1)) > 1


@pytest.mark.parametrize("settings", [SMALL, FROZEN], ids=["smooth", "frozen"])
def test_the_file_gives_the_same_drive(tmp_path, settings):
    simulated = simulate(settings)
    path = tmp_path / "sim.npz"
    truth_path = write_simulated(path, simulated)
    drive = npz.read(path)
    assert drive.name == "sim"
    assert_same_drive(drive, simulated.drive)
    truth = read_tum(truth_path)
    np.testing.assert_array_equal(truth.stamps, simulated.drive.ground_truth.stamps)
    np.testing.assert_array_equal(truth.positions, simulated.drive.ground_truth.positions)
    with np.load(path) as arrays:
        assert arrays["features"].shape == (4, 300, 80)
        assert arrays["features"].dtype == np.float64
        assert arrays["ground_truth_landmarks"].shape == (300, 3)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sim.npz", "sim.tum"]


def test_equal_drives_are_equal_files(tmp_path):
    for name in ("a", "b"):
        write_simulated(tmp_path / f"{name}.npz", simulate(SMALL))
    for suffix in (".npz", ".tum"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("existing", ["sim.npz", "sim.tum"])
def test_an_existing_file_is_kept_unless_forced(tmp_path, existing):
    simulated = simulate(SMALL)
    (tmp_path / existing).write_text("mine")
    with pytest.raises(VislamError, match=f"{existing}: exists already"):
        write_simulated(tmp_path / "sim.npz", simulated)
    assert [p.name for p in tmp_path.iterdir()] == [existing]
    assert (tmp_path / existing).read_text() == "mine"
    write_simulated(tmp_path / "sim.npz", simulated, force=True)
    assert npz.read(tmp_path / "sim.npz").steps == 80


def test_a_name_without_npz_or_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(VislamError, match=r"end its name in \.npz"):
        write_simulated(tmp_path / "sim.npy", simulate(SMALL))
    with pytest.raises(VislamError, match="cannot write"):
        write_simulated(tmp_path / "none" / "sim.npz", simulate(SMALL))


def test_impossible_settings_are_refused():
    for values in ({"steps": 1}, {"frozen_share": 0.9}, {"pixel_noise_std": -1.0}):
        with pytest.raises(SettingsError, match=next(iter(values))):
            settings_from_dict(SimulationSettings, values)


@pytest.mark.parametrize("steps", [2, 3, 40])
def test_the_shortest_drives_work(steps):
    for share in (0.0, 0.5):
        settings = SimulationSettings(steps=steps, landmarks=10, frozen_share=share)
        simulated = simulate(settings)
        assert simulated.drive.steps == steps
        assert simulated.drive.tracks == 10
