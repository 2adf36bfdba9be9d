# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The backward pass ends where filters that keep everything in their state end."""

import itertools

import numpy as np
import pytest
from dense_reference import DenseJointFilter
from tracked_drive import gappy_drive, run, trying_drive

from vislam_ros.core.filters.joint import JointFilter, JointSettings
from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.smoothing import tape
from vislam_ros.core.smoothing.backward import smooth
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings


@pytest.fixture(scope="module")
def drive() -> Drive:
    return trying_drive(steps=40, landmarks=240, seed=5)


def settings_of(**changes: object) -> JointSettings:
    settings = {
        "min_disparity": 6.0,
        "retire_after": 2,
        "velocity_noise_std": 0.1,
        "angular_velocity_noise_std": 0.01,
        "prior_pose_variance": 1e-4,
        **changes,
    }
    return JointSettings(**settings)  # type: ignore[arg-type]


def record(drive: Drive, settings: JointSettings) -> tuple[JointFilter, Tape]:
    recorded = Tape()
    filter_ = JointFilter(settings, drive.camera, recorded)
    for _ in run(filter_, drive, settings):
        pass
    return filter_, recorded


@pytest.mark.parametrize("initialization", ["correlated", "independent"])
@pytest.mark.parametrize(
    ("pixel_variance", "chi2_gate"), [((1.0,) * 4, 16.27), ((1.0, 1.2, 0.9, 1.1), 0.0)]
)
def test_final_map_and_smoothed_poses_are_those_of_the_filter_that_keeps_all(
    drive: Drive, initialization: str, pixel_variance: tuple[float, ...], chi2_gate: float
) -> None:
    settings = settings_of(
        landmark_initialization=initialization, pixel_variance=pixel_variance, chi2_gate=chi2_gate
    )
    recorded = Tape()
    filter_ = JointFilter(settings, drive.camera, recorded)
    dense = DenseJointFilter(settings, drive.camera, clone_poses=True)
    for increment, frame, _ in run(filter_, drive, settings):
        dense.step(increment, frame)
    smoothed = smooth(recorded)

    poses, pose_covariances = dense.smoothed()
    np.testing.assert_allclose(smoothed.poses, poses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(smoothed.pose_covariances, pose_covariances, rtol=0, atol=1e-9)
    assert len(smoothed.keys) + filter_.active == filter_.landmark_count
    for key, position, covariance in zip(
        smoothed.keys.tolist(), smoothed.positions, smoothed.covariances, strict=True
    ):
        exact_position, exact_covariance = dense.landmark(key)
        np.testing.assert_allclose(position, exact_position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(covariance, exact_covariance, rtol=0, atol=1e-9)
    # There was something to do: landmarks stood elsewhere when they were marginalized.
    as_they_stood = filter_.landmarks()[1][: len(smoothed.keys)]
    assert np.abs(smoothed.positions - as_they_stood).max() > 0.1


def test_recording_leaves_the_filter_as_it_is(drive: Drive) -> None:
    recorded, _ = record(drive, settings_of())
    plain = JointFilter(settings_of(), drive.camera)
    for _ in run(plain, drive, settings_of()):
        pass
    np.testing.assert_array_equal(recorded.T_world_body, plain.T_world_body)
    np.testing.assert_array_equal(recorded.covariance, plain.covariance)


def test_forward_from_a_checkpoint_the_covariance_is_the_filters(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tape, "_STEPS_BETWEEN_CHECKPOINTS", 7)
    _, recorded = record(drive, settings_of())
    assert len(recorded.checkpoints) == 6
    for checkpoint, following in itertools.pairwise(recorded.checkpoints):
        state = ErrorState(checkpoint.covariance, recorded.vehicle_size)
        for operation in checkpoint.operations:
            state.apply(operation)
        np.testing.assert_allclose(state.covariance, following.covariance, rtol=0, atol=1e-12)


def test_the_distance_of_checkpoints_does_not_matter(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = smooth(record(drive, settings_of())[1])
    monkeypatch.setattr(tape, "_STEPS_BETWEEN_CHECKPOINTS", 3)
    pieces = smooth(record(drive, settings_of())[1])
    np.testing.assert_array_equal(pieces.keys, whole.keys)
    for name in ("poses", "pose_covariances", "positions", "covariances"):
        np.testing.assert_allclose(
            getattr(pieces, name), getattr(whole, name), rtol=0, atol=1e-9, err_msg=name
        )


def test_a_tape_can_be_smoothed_while_the_drive_goes_on(drive: Drive) -> None:
    settings = settings_of()
    recorded = Tape()
    filter_ = JointFilter(settings, drive.camera, recorded)
    for k, _ in enumerate(run(filter_, drive, settings)):
        if k == 20:
            midway = smooth(recorded)
            assert len(midway.poses) == 21
            np.testing.assert_allclose(midway.poses[-1], filter_.T_world_body, rtol=0, atol=1e-12)
    undisturbed = smooth(record(drive, settings)[1])
    np.testing.assert_array_equal(smooth(recorded).positions, undisturbed.positions)


def test_an_empty_tape_gives_nothing() -> None:
    smoothed = smooth(Tape())
    assert smoothed.poses.shape == (0, 4, 4)
    assert smoothed.pose_covariances.shape == (0, 6, 6)
    assert smoothed.positions.shape == (0, 3)
    assert smoothed.covariances.shape == (0, 3, 3)


def test_covariances_stay_positive_and_never_grow_over_a_long_drive_with_far_landmarks() -> None:
    drive = gappy_drive(SimulationSettings(steps=400, landmarks=1500, seed=5, frozen_share=0.1))
    settings = settings_of(min_disparity=1.0)
    filter_, recorded = record(drive, settings)
    smoothed = smooth(recorded)
    as_they_stood = filter_.landmarks()[2][: len(smoothed.keys)]
    scale = np.trace(as_they_stood, axis1=1, axis2=2)[:, None]
    assert scale.max() > 1e4
    assert np.all(np.linalg.eigvalsh(smoothed.covariances) > 0)
    assert np.all(np.linalg.eigvalsh(as_they_stood - smoothed.covariances) > -1e-9 * scale)
    assert np.all(np.linalg.eigvalsh(smoothed.pose_covariances) > 0)
