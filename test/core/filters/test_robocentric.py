# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter over the landmarks in view is the filter over all ever seen."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from dense_robocentric import DenseRobocentricFilter
from dense_state import BIAS, LENS, POSE
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from plain_belief import Told
from tracked_drive import run, trying_drives

from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.robocentric import RobocentricFilter
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.data.drive import Drive

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def drives() -> dict[str, Drive]:
    made = trying_drives(steps=24, landmarks=120, seed=6)
    stated = np.random.default_rng(7).uniform(0.2, 2.0, len(made["white"].ids))
    return {
        **made,
        "gyroscope": made["white"].moved_by("gyro"),
        "stated": dataclasses.replace(made["white"], noise=stated.astype(np.float32)),
        "turning unseen": turning_unseen(made["white"]),
        "wrong twists": with_wrong_twists(made["white"]),
        "struck": struck(made["white"]),
    }


def turning_unseen(drive: Drive) -> Drive:
    """The drive without three of its frames, and with a turn meanwhile."""
    twists = drive.twists.copy()
    twists[12:15, 5] += [0.5, 1.0, 0.5]
    seen = ~np.isin(np.arange(drive.steps), [12, 13, 14])
    return dataclasses.replace(drive.with_frames(seen), twists=twists)


def with_wrong_twists(drive: Drive) -> Drive:
    """The drive with a twist of nothing, one that is too fast, and one that turns."""
    twists = drive.twists.copy()
    twists[12] = 0.0
    twists[15, 0] += 20.0
    twists[18, 5] += 2.0
    return dataclasses.replace(drive, twists=twists)


def struck(drive: Drive) -> Drive:
    """The drive with the motion of three steps in the time of one, as its twist says."""
    kept = ~np.isin(np.arange(drive.steps), [18, 19])
    count, twists = np.count_nonzero(kept), drive.twists[kept].copy()
    twists[18] = drive.twists[18:21].sum(axis=0)
    return dataclasses.replace(
        drive.with_frames(kept),
        twists=twists,
        twist_stamps=drive.twist_stamps[:count],
        feature_stamps=drive.feature_stamps[:count],
    )


def told_numbers(outcome: Outcome) -> list[Array]:
    return [np.array(list(estimate.numbers().values())) for estimate in outcome.estimates]


def dense_numbers(dense: DenseRobocentricFilter, told: Told) -> list[Array]:
    """What the filter tells of itself, from the dense one's state, covariance and noise."""
    mean, std = dense.estimate + told.mean, np.sqrt(np.diag(told.covariance))
    # As far as the bias that there may be is from the one that is told.
    std[BIAS] = np.sqrt(np.diag(dense.P)[BIAS] + told.mean[BIAS] ** 2)
    noise = dense.track_noise
    pixel_variance = noise.level * noise.usual_factor * np.mean(np.diag(dense.told_V))
    twist_std = np.sqrt(dense.motion_noise.twist_variance)
    walk_std = np.sqrt(dense.motion_noise.walk_variance)
    return [
        *(np.append(mean[rows], std[rows]) for rows in (BIAS, LENS)),
        *(np.array([level]) for level in (pixel_variance**0.5, twist_std[0], twist_std[5])),
        *(walk_std[:3], walk_std[3:]),
    ]


def assert_map_is_told(
    filter_: RobocentricFilter, dense: DenseRobocentricFilter, told: Told, tolerance: float
) -> None:
    """Landmarks are where both beliefs together have them, now or when they were marginalized."""
    keys, positions, covariances = filter_.landmarks()
    tracked = np.isin(keys, filter_.keys)
    assert set(keys[~tracked].tolist()) == set(dense.mapped)
    for i in range(0, len(keys), 5):
        key = int(keys[i])
        position, covariance = dense.landmark(key, told) if tracked[i] else dense.mapped[key]
        assert_allclose(positions[i], position, rtol=tolerance, atol=tolerance)
        # Covariances of far landmarks are thousands of square metres.
        size = max(1.0, np.abs(covariance).max())
        assert_allclose(covariances[i], covariance, rtol=0, atol=10 * tolerance * size)


TOLD = [
    ((1.0,) * 4, {"gyro_bias_walk_std": 0.01, "prior_pose_variance": 1e-4, "pixel_gate": 5.0}),
    ((1.0, 1.2, 0.9, 1.1), {"chi2_gate": 0.0, "retire_after": 1}),
    ((1.0, 1.2, 0.9, 1.2), {"gyro_bias_std": 0.0, "lens_distortion_std": 0.0}),
    ((0.2,) * 4, {"gyro_bias_std": 0.005}),
    ((1.0,) * 4, {"learn_noise": False}),
]


@pytest.mark.parametrize(
    ("kind", "pixel_variance", "changes"),
    [
        *((kind, *told) for kind in ("white", "offsets") for told in TOLD),
        *(("gyroscope", *told) for told in TOLD[1:3]),
        *(("stated", *told) for told in TOLD[::2]),
        ("turning unseen", *TOLD[0]),
        ("wrong twists", *TOLD[0]),
        ("struck", *TOLD[0]),
    ],
)
def test_state_and_covariance_are_the_dense_filters(
    drives: dict[str, Drive],
    kind: str,
    pixel_variance: tuple[float, ...],
    changes: dict[str, Any],
) -> None:
    drive = drives[kind]
    usual = {"retire_after": 2, "rest_after_rejection": 2}
    settings = RobocentricSettings(**{**usual, "pixel_variance": pixel_variance, **changes})
    filter_ = RobocentricFilter(settings, drive.camera)
    dense = DenseRobocentricFilter(settings, drive.camera)
    rejected, shares = 0, []
    # At the first step a landmark's place is known to hundreds of pixels, and then to one: in both
    # filters rounding of S, of up to 1e7 square pixels, costs digits that no inverse has back, and
    # most of them where a landmark is rejected then.
    tolerance = 3e-6 if kind == "gyroscope" else 1e-9
    for increment, frame, outcome in run(filter_, drive, settings):
        assert dense.step(increment, frame) == outcome.rejected.tolist()
        rejected += len(outcome.rejected)
        keys = filter_.keys.tolist()
        assert set(keys) == set(dense.place_of_key)
        rows, told = dense.active_rows(keys), dense.told()
        body = dense.body_twist_rows()
        shares.append(told.none)
        state = np.concatenate(
            [
                filter_.vehicle.twist,
                filter_.vehicle.gyro_bias,
                [filter_.vehicle.kappa],
                filter_.vehicle.drift,
                filter_.image_points.ravel(),
            ]
        )
        for ours, plain in [
            (filter_.T_world_body, dense.T_world_body),
            (filter_.pose_covariance, dense.P[:6, :6]),
            (state, dense.estimate[rows[6:]]),
            (filter_.covariance, dense.P[np.ix_(rows, rows)]),
            (outcome.pose.T_world_body, dense.told_pose(told)),
            (outcome.pose.covariance, told.covariance[POSE, POSE]),
            (outcome.twist.mean, body @ (dense.estimate + told.mean)),
            (outcome.twist.covariance, body @ told.covariance @ body.T),
            *zip(told_numbers(outcome), dense_numbers(dense, told), strict=True),
        ]:
            np.testing.assert_allclose(ours, plain, rtol=0, atol=tolerance)
        assert_map_is_told(filter_, dense, told, tolerance)
    assert dense.track_noise.has_offsets == (kind == "offsets" and settings.learn_noise)
    weighed = np.array(shares)
    if settings.gyro_bias_std == 0:
        assert not np.any(weighed)
    else:
        assert np.count_nonzero((weighed > 0.05) & (weighed < 0.999)) > 10
    assert len(dense.P) > 3 * 120
    assert filter_.active < 110
    assert (rejected > 10) == (settings.chi2_gate > 0)
