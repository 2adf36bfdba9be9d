# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of merit: against cases with known answers, and against evo's commands."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from evo_commands import evo_statistics
from numpy.typing import NDArray
from step_rows import step_row

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.alignment import alignment, first_pose_alignment
from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.evaluation.consistency import normalised_errors
from vislam_ros.data.evaluation.evaluate import compare, evaluate, evaluate_results
from vislam_ros.data.evaluation.relative import distance_pairs, frame_pairs
from vislam_ros.data.results.writer import ResultWriter
from vislam_ros.data.trajectory import Trajectory, path_length, read_tum, write_tum
from vislam_ros.errors import VislamError

SECOND = 1_000_000_000


def winding_drive(seed: int, poses: int = 400) -> Trajectory:
    """A drive of about 1.2 m and 0.1 s a step that turns, climbs and stands still at times."""
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (poses, 1, 1))
    for k in range(1, poses):
        moving = k % 100 > 20
        u = rng.normal([1.2, 0, 0, 0, 0, 0.02], [0.1, 0.01, 0.02, 0.002, 0.002, 0.03]) * moving
        T[k] = T[k - 1] @ se3.exp(u)
    stamps = 1_317_386_425 * SECOND + 100_000_000 * np.arange(poses)
    return Trajectory.from_matrices(stamps, T)


def perturbed(trajectory: Trajectory, seed: int) -> Trajectory:
    """A copy that drifts, starts elsewhere, lacks poses and has stamps a little off."""
    rng = np.random.default_rng(seed)
    T = trajectory.T_world_body
    noise = rng.normal(scale=[0.03, 0.03, 0.03, 1e-3, 1e-3, 1e-3], size=(len(T), 6))
    steps = se3.inverse(T[:-1]) @ T[1:] @ se3.exp(noise[1:])
    drifted = [se3.exp([5.0, -3.0, 1.0, 0.1, -0.2, 2.0])]
    for step in steps:
        drifted.append(drifted[-1] @ step)
    kept = np.flatnonzero(rng.random(len(T)) < 0.9)
    stamps = trajectory.stamps + rng.integers(-12_000_000, 12_000_000, len(T))
    return Trajectory.from_matrices(stamps[kept], np.array(drifted)[kept])


@pytest.fixture(params=["synthetic", "denser estimate", "0027", "0020", "10_synthetic"])
def pair(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """Files of a reference and an estimate."""
    if request.param == "synthetic":
        truth = winding_drive(4)
        estimate = perturbed(truth, 5)
    elif request.param == "denser estimate":
        dense = winding_drive(6)
        truth = Trajectory(dense.stamps[::3], dense.positions[::3], dense.quaternions[::3])
        estimate = perturbed(dense, 7)
    else:
        folder: Path = request.getfixturevalue("shared_data")
        truth = read_tum(folder / "ground_truth" / f"{request.param}.tum")
        estimate = perturbed(truth, 8)
    write_tum(tmp_path / "reference.tum", truth)
    write_tum(tmp_path / "estimate.tum", estimate)
    return tmp_path / "reference.tum", tmp_path / "estimate.tum"


@pytest.mark.timeout(300)
def test_figures_equal_evo(pair: tuple[Path, Path], tmp_path: Path) -> None:
    ours = compare(read_tum(pair[0]), read_tum(pair[1]))
    metres = ("--delta", "100", "--delta_unit", "m")
    degrees = ("--pose_relation", "angle_deg")
    for figure, command, options in (
        ("ate_m", "evo_ape", ("--align",)),
        ("rpe_frame_m", "evo_rpe", ()),
        ("rpe_frame_deg", "evo_rpe", degrees),
        ("rpe_100m_m", "evo_rpe", metres),
        ("rpe_100m_deg", "evo_rpe", (*metres, *degrees)),
    ):
        theirs = evo_statistics(tmp_path, command, *pair, *options)
        for name, value in ours[figure].items():
            assert value == pytest.approx(theirs[name], rel=1e-9, abs=1e-11), (figure, name)


def stamped(*milliseconds: int) -> Trajectory:
    stamps = np.array(milliseconds, dtype=np.int64) * 1_000_000
    poses = len(stamps)
    return Trajectory(stamps, np.zeros((poses, 3)), np.tile([0.0, 0, 0, 1], (poses, 1)))


def test_poses_are_matched_to_the_nearest_in_time() -> None:
    i, j = associate(stamped(0, 100, 200, 300), stamped(4, 189, 310, 410))
    assert (i.tolist(), j.tolist()) == ([0, 3], [0, 2])
    i, j = associate(stamped(0, 10, 20, 30), stamped(15, 29))
    assert (i.tolist(), j.tolist()) == ([1, 3], [0, 1])
    i, j = associate(stamped(15, 29), stamped(0, 10, 20, 30))
    assert (i.tolist(), j.tolist()) == ([0, 1], [1, 3])
    i, j = associate(stamped(0, 1000), stamped(400, 1400), max_difference=0.5)
    assert (i.tolist(), j.tolist()) == ([0, 1], [0, 1])


def test_trajectories_of_other_times_are_refused() -> None:
    with pytest.raises(VislamError, match=r"0 poses of the reference lie within 0.01 s"):
        associate(stamped(0, 100), stamped(5000, 5100))


def test_a_trajectory_without_a_pose_is_named() -> None:
    with pytest.raises(VislamError, match=r"^the estimate has no pose"):
        associate(stamped(0, 100), stamped())
    with pytest.raises(VislamError, match=r"^the reference has no pose"):
        associate(stamped(), stamped(0, 100))


def test_alignment_recovers_a_rigid_motion() -> None:
    rng = np.random.default_rng(9)
    T = se3.exp([1.0, 2.0, 3.0, 0.5, -2.0, 1.0])
    points = rng.normal(size=(50, 3))
    moved = points @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_allclose(alignment(points, moved), T, atol=1e-12)


@pytest.mark.parametrize("direction", [[1.0, 2.0, 0.5], [0.0, 0.0, 0.0]])
def test_a_straight_or_standing_drive_is_aligned_without_error(direction: list[float]) -> None:
    points = np.linspace(0.0, 10.0, 20)[:, None] * np.array(direction)
    T = se3.exp([1.0, 2.0, 3.0, 0.5, -2.0, 1.0])
    moved = points @ T[:3, :3].T + T[:3, 3]
    found = alignment(points, moved)
    np.testing.assert_allclose(points @ found[:3, :3].T + found[:3, 3], moved, atol=1e-12)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)


def test_a_moved_copy_has_no_error() -> None:
    truth = winding_drive(10)
    moved = Trajectory.from_matrices(
        truth.stamps, se3.exp([9.0, 8.0, 7.0, 1.0, 1.0, 1.0]) @ truth.T_world_body
    )
    figures = compare(truth, moved)
    for name in ("ate_m", "rpe_frame_m", "rpe_frame_deg", "rpe_100m_m", "rpe_100m_deg"):
        assert figures[name]["max"] < 1e-9
    T = first_pose_alignment(truth, moved)
    np.testing.assert_allclose(T, se3.exp([9.0, 8.0, 7.0, 1.0, 1.0, 1.0]), atol=1e-12)


def test_pairs_follow_one_another() -> None:
    assert frame_pairs(7, 3).tolist() == [[0, 3], [3, 6]]
    positions = np.array([[0.0, 0, 0], [3, 0, 0], [3, 3, 0], [3, 3, 1], [3, 3, 9]])
    assert distance_pairs(positions, 5.0).tolist() == [[0, 2], [2, 4]]
    assert distance_pairs(positions, 500.0).shape == (0, 2)


def test_a_short_drive_has_no_long_relative_error() -> None:
    truth = winding_drive(11, poses=20)
    assert path_length(truth) < 100.0
    assert compare(truth, truth)["rpe_100m_m"] is None


def random_covariances(poses: int, seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(poses, 6, 6)) * np.array([0.1, 0.1, 0.1, 1e-4, 1e-4, 1e-4])[:, None]
    return A @ np.swapaxes(A, 1, 2) + np.diag([1e-3] * 3 + [1e-9] * 3)


def test_errors_drawn_from_their_covariance_are_consistent() -> None:
    rng = np.random.default_rng(12)
    T_estimate = winding_drive(13, poses=4000).T_world_body
    covariances = random_covariances(4000, 14)
    covariances[0] = 0.0
    xi = np.einsum(
        "nij,nj->ni",
        np.linalg.cholesky(covariances + 1e-30 * np.eye(6)),
        rng.normal(size=(4000, 6)),
    )
    xi[0] = 0.0
    moved = se3.exp([4.0, 5.0, 6.0, 0.3, 0.2, 0.1])
    nees = normalised_errors(moved @ T_estimate @ se3.exp(xi), T_estimate, covariances)
    assert np.flatnonzero(np.isnan(nees)).tolist() == [0]
    # The mean of 3999 chi-square variables over 6 has a standard deviation of 0.009.
    assert np.nanmean(nees) == pytest.approx(1.0, abs=0.04)


def test_nees_follows_its_definition_whatever_the_scale() -> None:
    covariances = random_covariances(3, 15)
    T = np.tile(np.eye(4), (3, 1, 1))
    xi = np.array([1e-3, -2e-3, 0.0, 1e-5, 0.0, 2e-5])
    T_reference = np.stack([np.eye(4), se3.exp(xi), se3.exp(xi)])
    expected = xi @ np.linalg.solve(covariances[1], xi) / 6
    nees = normalised_errors(T_reference, T, covariances)
    assert nees[:2] == pytest.approx([0.0, expected])
    tiny = normalised_errors(T_reference, T, 1e-18 * covariances)
    assert tiny[1] == pytest.approx(1e18 * expected)


def test_covariances_without_an_inverse_are_left_out_and_counted() -> None:
    truth = winding_drive(16, poses=6)
    covariances = random_covariances(6, 17)
    covariances[0] = 0.0
    covariances[1, 2, :] = covariances[1, :, 2] = 0.0
    covariances[2] = np.ones((6, 6))
    covariances[3] = np.nan
    figures = compare(truth, truth, covariances)
    assert (figures["nees_poses"], figures["nees_left_out"]) == (2, 4)
    assert figures["nees_per_dof"] == pytest.approx(0.0, abs=1e-12)
    figures = compare(truth, truth, np.zeros((6, 6, 6)))
    assert figures["nees_per_dof"] is None
    assert figures["nees_left_out"] == 6


def write_run(directory: Path, trajectory: Trajectory) -> None:
    with ResultWriter(directory) as writer:
        for k, stamp in enumerate(trajectory.stamps.tolist()):
            pose = (trajectory.positions[k], trajectory.quaternions[k])
            writer.add_step(*pose, k * np.eye(6), step_row(stamp))
            writer.add_dead_reckoning(stamp, *pose)
        writer.finish(complete=True)


def test_a_result_directory_is_evaluated_to_plain_json(tmp_path: Path) -> None:
    truth = winding_drive(18, poses=100)
    write_tum(tmp_path / "reference.tum", truth)
    write_run(tmp_path / "results", perturbed(truth, 19))
    evaluation = evaluate_results(tmp_path / "results", tmp_path / "reference.tum")
    assert evaluation["reference_length_m"] == pytest.approx(path_length(truth))
    assert evaluation["trajectory"]["nees_left_out"] <= 1
    assert evaluation["dead_reckoning"]["ate_m"] == evaluation["trajectory"]["ate_m"]
    assert "smoothed" not in evaluation
    assert json.loads(json.dumps(evaluation)) == evaluation


def test_the_wrong_reference_is_named(tmp_path: Path) -> None:
    write_run(tmp_path / "results", winding_drive(20, poses=10))
    write_tum(tmp_path / "other.tum", stamped(0, 100, 200))
    with pytest.raises(VislamError, match=r"other.tum: 0 poses of the reference"):
        evaluate_results(tmp_path / "results", tmp_path / "other.tum")


def test_smoothed_poses_are_judged_with_their_own_covariances(tmp_path: Path) -> None:
    truth = winding_drive(18, poses=100)
    write_tum(tmp_path / "reference.tum", truth)
    estimate = perturbed(truth, 19)
    with ResultWriter(tmp_path / "results") as writer:
        for k, stamp in enumerate(estimate.stamps.tolist()):
            pose = (estimate.positions[k], estimate.quaternions[k])
            writer.add_step(*pose, np.eye(6), step_row(stamp))
        writer.set_smoothed(estimate, np.tile(0.25 * np.eye(6), (len(estimate), 1, 1)))
        writer.finish(complete=True)
    evaluation = evaluate_results(tmp_path / "results", tmp_path / "reference.tum")
    filtered, smoothed = evaluation["trajectory"], evaluation["smoothed"]
    assert smoothed["ate_m"] == filtered["ate_m"]
    assert smoothed["nees_per_dof"] == pytest.approx(4 * filtered["nees_per_dof"])


def test_an_estimate_is_evaluated_against_a_reference_from_memory_or_from_files(
    tmp_path: Path,
) -> None:
    truth = winding_drive(18, poses=100)
    estimate = perturbed(truth, 19)
    covariances = np.tile(0.25 * np.eye(6), (len(estimate), 1, 1))
    figures = compare(truth, estimate, covariances)
    known = dataclasses.replace(estimate, covariances=covariances)
    evaluation = evaluate(known, truth)
    assert evaluation.poses == figures["poses"]
    assert vars(evaluation.ate) == figures["ate_m"]
    assert vars(evaluation.rpe_frame) == figures["rpe_frame_m"]
    assert vars(evaluation.rpe_frame_deg) == figures["rpe_frame_deg"]
    assert evaluation.nees_per_dof == figures["nees_per_dof"]
    assert evaluation.nees_inside == figures["nees_inside"]
    assert evaluation.kitti_percent == figures["kitti"]["translation_percent"]
    assert evaluation.kitti_deg_per_100m == figures["kitti"]["rotation_deg_per_100m"]
    write_tum(tmp_path / "truth.tum", truth)
    write_tum(tmp_path / "estimate.tum", estimate)
    from_files = evaluate(str(tmp_path / "estimate.tum"), tmp_path / "truth.tum")
    assert from_files == dataclasses.replace(
        evaluation, nees_per_dof=None, nees_bounds=None, nees_inside=None
    )
