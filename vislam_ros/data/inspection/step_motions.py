# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the images of each step tell: the body's turn, and how its tracks go along with it.

The motion of a step is that of its images alone (see image_motion), so it can be held against the
gyroscope; where they are too few for that, it is the twist's. What a track is off by then is held
in the standard deviations that a pixel's noise explains, with that of its disparity.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import image_points_of
from vislam_ros.core.geometry.warp import warp
from vislam_ros.core.verdict.image_motion import image_motion
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS

Array = NDArray[np.float64]

# Points that tell a motion well, wrong ones among them.
_FEWEST_POINTS = 10
# Steps looked at, in runs that are spread over the drive, to save time.
_MOST_STEPS, _RUN = 3000, 300
# Steps of which more pairs than this share repeat their pixels tell nothing.
_REPEATED_SHARE = 0.5
_LEFT = np.array([0, 2])


@dataclass(frozen=True)
class StepMotions:
    """Steps, and the tracks in them.

    Attributes
    ----------
    steps : int
        Number of steps looked at.
    turn_errors : ndarray, (n, 3)
        Of steps whose images tell the motion: measured angular velocity less that of the images,
        body axes, rad/s.
    tracks : ndarray of int64, (m,)
        Track of each observation that follows another; a track that was repeated is another one
        from then on.
    errors : ndarray, (m, 2)
        How far the left pixel is from where the motion takes it.
    noise : ndarray, (m, 2, 2)
        Covariance of that for a noise of 1 px.
    by_disparity : ndarray, (m, 2)
        How far an error of the disparity moves it, by pixel.
    by_twist : ndarray of bool, (m,)
        Whether the motion is the twist's.
    """

    steps: int
    turn_errors: Array
    tracks: NDArray[np.int64]
    errors: Array
    noise: Array
    by_disparity: Array
    by_twist: NDArray[np.bool_]


def step_motions(drive: Drive) -> StepMotions:
    """Look at the steps of a drive."""
    camera = drive.camera
    R_body_camera = camera.T_body_camera[:3, :3]
    path = _mean_twists(drive)
    turns: list[Array] = [np.empty((0, 3))]
    tracks: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
    errors, noises, parallaxes = [np.empty((0, 2))], [np.empty((0, 2, 2))], [np.empty((0, 2))]
    by_twist: list[NDArray[np.bool_]] = [np.empty(0, dtype=bool)]
    generation, start, steps = 0, np.eye(4), 0
    for k in _looked_at(drive.steps - 1).tolist():
        ids, before, after = drive.followed(k)
        if np.sum(np.all(before == after, axis=1)) > _REPEATED_SHARE * len(before):
            generation += len(before) > 0
            continue
        tau = float(drive.feature_stamps[k + 1] - drive.feature_stamps[k]) / NANOSECONDS
        twist = path[k]
        steps += 1
        y, y_after = image_points_of(before), image_points_of(after)
        T, told = None, np.isfinite(twist[3:]).all()
        if len(y) >= _FEWEST_POINTS:
            motion = image_motion(camera, y, y_after, start)
            start = motion.T_new_old
            if motion.is_one:
                T = motion.T_new_old
                if told:
                    turns.append((twist[3:] - R_body_camera @ motion.xi[3:] / tau)[None])
        is_told = T is None
        if T is None:
            if not np.isfinite(twist).all():
                continue
            T = camera.T_camera_body @ se3.exp(-tau * twist) @ camera.T_body_camera
        T_body = camera.T_body_camera @ se3.inverse(T) @ camera.T_camera_body
        warped = warp(camera, y, T_body)
        ahead = warped.ahead
        F = warped.F_y[ahead][:, _LEFT]
        noises.append((F * [1.0, 1.0, 0.5]) @ np.swapaxes(F, 1, 2) + np.diag([1.0, 0.5]))
        errors.append(y_after[ahead][:, _LEFT] - warped.y[ahead][:, _LEFT])
        # The right pixel is what makes a disparity wrong: the row and the left one are seen again.
        parallaxes.append(F[:, :, 1])
        tracks.append(ids[ahead].astype(np.int64) + (generation << 32))
        by_twist.append(np.full(int(ahead.sum()), is_told))
    return StepMotions(
        steps,
        np.concatenate(turns),
        np.concatenate(tracks),
        np.concatenate(errors),
        np.concatenate(noises),
        np.concatenate(parallaxes),
        np.concatenate(by_twist),
    )


def _looked_at(steps: int) -> NDArray[np.int64]:
    """First frames of the steps that are looked at."""
    all_steps = np.arange(max(steps, 0))
    if steps <= _MOST_STEPS:
        return all_steps
    begins = np.linspace(0, steps - _RUN, _MOST_STEPS // _RUN).astype(int)
    return np.unique((begins[:, None] + np.arange(_RUN)).ravel())


def _mean_twists(drive: Drive) -> Array:
    """Mean twist (T - 1, 6) over each step; NaN where none is known."""
    n = max(drive.steps - 1, 0)
    result = np.full((n, 6), np.nan)
    if not len(drive.twists):
        return result
    # The integral of the samples, which hold up to their stamps, at all knots.
    stamps = (drive.twist_stamps - drive.feature_stamps[0]) / NANOSECONDS
    frames = (drive.feature_stamps - drive.feature_stamps[0]) / NANOSECONDS
    integral = np.concatenate(
        [np.zeros((1, 6)), np.cumsum(np.diff(stamps)[:, None] * drive.twists[1:], axis=0)]
    )
    at_frames = np.column_stack([np.interp(frames, stamps, integral[:, i]) for i in range(6)])
    known = (frames >= stamps[0]) & (frames <= stamps[-1])
    both = known[1:] & known[:-1]
    result[both] = (np.diff(at_frames, axis=0) / np.diff(frames)[:, None])[both]
    return result
