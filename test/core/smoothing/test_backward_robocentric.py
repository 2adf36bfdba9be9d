# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter's backward pass ends where a filter that keeps everything ends."""

import numpy as np
import pytest
from dense_robocentric import DenseRobocentricFilter
from tracked_drive import run, trying_drives

from vislam_ros.core.filters.robocentric import RobocentricFilter
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.smoothing.backward import smooth
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.data.drive import Drive


@pytest.fixture(scope="module")
def drives() -> dict[str, Drive]:
    return trying_drives(steps=24, landmarks=100, seed=7)


@pytest.mark.parametrize("kind", ["white", "offsets"])
@pytest.mark.parametrize(
    ("pixel_variance", "chi2_gate", "retire_after"),
    [((1.0,) * 4, 16.27, 2), ((1.0, 1.2, 0.9, 1.1), 0.0, 1)],
)
def test_final_map_and_smoothed_poses_are_those_of_the_filter_that_keeps_all(
    drives: dict[str, Drive],
    kind: str,
    pixel_variance: tuple[float, ...],
    chi2_gate: float,
    retire_after: int,
) -> None:
    drive = drives[kind]
    settings = RobocentricSettings(
        pixel_variance=pixel_variance,
        chi2_gate=chi2_gate,
        retire_after=retire_after,
        rest_after_rejection=2,
        prior_pose_variance=1e-4,
        gyro_bias_std=0.005,
    )
    recorded = Tape()
    filter_ = RobocentricFilter(settings, drive.camera, recorded)
    dense = DenseRobocentricFilter(settings, drive.camera, exchange=True, clone_poses=True)
    for increment, frame, _ in run(filter_, drive, settings):
        dense.step(increment, frame)
    smoothed = smooth(recorded)

    told = dense.told()
    # Both beliefs count.
    assert 0.05 < told.none < 0.995
    poses, pose_covariances = dense.smoothed(told)
    np.testing.assert_allclose(smoothed.poses, poses, rtol=0, atol=1e-9)
    np.testing.assert_allclose(smoothed.pose_covariances, pose_covariances, rtol=0, atol=1e-9)

    keys, positions, covariances = filter_.landmarks()
    # Those without a position have left the error state, but not for the map.
    mapped = np.isin(smoothed.keys, keys)
    marginalized, tracked = slice(0, mapped.sum()), slice(mapped.sum(), None)
    np.testing.assert_array_equal(smoothed.keys[mapped], keys[marginalized])
    for key, position, covariance in zip(
        keys.tolist(),
        np.concatenate([smoothed.positions[mapped], positions[tracked]]),
        np.concatenate([smoothed.covariances[mapped], covariances[tracked]]),
        strict=True,
    ):
        exact_position, exact_covariance = dense.landmark(key, told)
        np.testing.assert_allclose(position, exact_position, rtol=0, atol=1e-9)
        # Covariances of far landmarks are thousands of square metres.
        size = max(1.0, np.abs(exact_covariance).max())
        np.testing.assert_allclose(covariance, exact_covariance, rtol=0, atol=1e-9 * size)
    # There was something to do: landmarks stood elsewhere when they were marginalized.
    assert np.abs(smoothed.positions[mapped] - positions[marginalized]).max() > 0.1
    assert len(keys) > 80
    assert dense.track_noise.has_offsets == (kind == "offsets")
    if kind == "white":
        assert not np.all(mapped)
