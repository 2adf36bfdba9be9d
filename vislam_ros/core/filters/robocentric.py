# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The joint EKF in disparity space, with the body's twist and the sensors' biases in its state.

A landmark is its image point ``y = (u_left, u_right, v)`` in the current left camera. Its first
observation is itself the landmark's estimate, its noise the landmark's covariance, and it depends
on nothing else: initializing is exact. Observing is linear. The one nonlinearity is the warp over
a step (see warp), which is mild at every depth and for every disparity, zero and negative ones
included.

Image points are kept free of the lens's distortion, observations are freed of it by the present
kappa, and a landmark's error is the one that remains at a given kappa: ``y = y_hat + delta_y +
D(y_hat) delta_kappa`` (see lens). So a wrong kappa shows in the motion of image points only, as
it does in a camera.

These are the terms of the EKF (the report's eq. 25-36), as robocentric_model and warp have them::

    state  T, u, b_g, b_v, kappa, y_1 ... y_n: pose, twist, biases of gyroscope and velocity,
           lens, landmarks; T = T_hat Exp(xi), all other errors are differences
    Q      tau blkdiag(0, W_u, W_g, W_v, 0), a random walk of u and of the biases alone
    F      [ Ad(Exp(-tau u))  tau J_r      0  0                0           ]  xi
           [ 0                I            0  0                0           ]  delta_u
           [ 0                0            I  0                0           ]  delta_b
           [ 0                0            0  1                0           ]  delta_kappa
           [ 0                tau G_i J_r  0  F_i D_i - D_i+   blkdiag F_i ]  delta_y_i
    h, H   of the twist: [v + b_v; omega + b_g], [0 I B 0 0]; of no slip: v_y and v_z
           of the image: y, [0 I]

A step from stamp k - 1 to k, of tau seconds; where it spans many samples of the twist, 2 to 4 are
taken sample by sample, and where samples are missing, 3 is left out:

1. Landmarks whose track has ended are marginalized, and enter the map where they have a position.
2. The vehicle state takes a random step, ``P <- P + Q``: above all the twist u (white acceleration
   noise), which now stands for the constant twist of this step.
3. The prediction's mean twist over this step measures it.
4. The body moves, ``T <- T Exp(tau u)``, and every landmark is warped by the same motion, ``P <- F
   P F^T``. No noise enters here: all of it is in u, whose correlation with pose and landmarks is
   kept. Landmarks that are behind the camera now are marginalized before.
5. The frame's image points correct everything, but for those that gates reject; the landmarks of
   these are marginalized before.
6. The noise of the motion is learned from what vision has seen of it.
7. Landmarks seen for the first time are initialized.

``test/twins/dense_robocentric.py`` is the same filter in plain numpy, without regard to speed; a
test holds the two together to 1e-9.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from vislam_ros.core.columns import Estimate
from vislam_ros.core.filters import quantities
from vislam_ros.core.filters.estimator import Outcome
from vislam_ros.core.filters.image_point_map import (
    ImagePointMap,
    ImagePoints,
    has_position,
    positions_of_all,
    world_positions,
)
from vislam_ros.core.filters.registry import register_estimator
from vislam_ros.core.filters.robocentric_model import (
    GYRO_BIAS,
    LENS,
    POSE,
    POSE_AND_LENS,
    SIZE,
    TWIST,
    VELOCITY_BIAS,
    TwistMeasurement,
    prior_covariance,
    transition_of,
    walk_densities,
)
from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.geometry.warp import warp
from vislam_ros.core.linalg.gating import Inliers, deletion_gate, passes_gates
from vislam_ros.core.motion import Increment, Twist
from vislam_ros.core.noise.disparity_prior import DisparityPrior
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.motion_noise import MotionNoise
from vislam_ros.core.noise.track_noise import TrackNoise
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState, Recorder
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization
from vislam_ros.core.operations.transition import RandomWalk
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.core.tracking.tracks import indices_of, is_member

Array = NDArray[np.float64]

# Nothing moves in less than this, and no twist can be had from it [s].
_SHORTEST_STEP = 1e-4


class RobocentricFilter:
    """EKF over ``[xi; delta u; delta b_g; delta b_v; delta kappa; delta y_1; ...; delta y_n]``.

    Parameters
    ----------
    settings : RobocentricSettings
    camera : StereoCamera
    tape : Recorder, optional
        Where to record for the backward pass.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    twist : ndarray, (6,)
        ``[v; omega]`` of the body over the last step, metres and radians a second.
    gyro_bias : ndarray, (3,)
        Radians a second.
    kappa : float
        What rectification has left of the lens's radial distortion (see lens).
    velocity_bias : ndarray, (2,)
        Of the measured velocity's y and z, metres a second.
    keys : ndarray of int64, (n,)
        The active landmarks.
    image_points : ndarray, (n, 3)
        Theirs, in the current left camera, pixels, free of distortion.
    """

    def __init__(
        self, settings: RobocentricSettings, camera: StereoCamera, tape: Recorder | None = None
    ):
        self._settings = settings
        self._camera = camera
        self._observation = StereoObservation(camera, settings.pixel_variance)
        self._frame_rate = FrameRate()
        self._motion_noise = MotionNoise(
            np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3),
            np.repeat([settings.velocity_walk_std, settings.angular_velocity_walk_std], 3),
            self._frame_rate,
        )
        self._twist_variance = self._motion_noise.twist_variance
        self._track_noise = TrackNoise(
            np.diag(self._observation.image_point_noise).copy(),
            settings.disparity_offset_std,
            self._frame_rate,
            learns=settings.learn_noise,
        )
        self._disparity_prior = DisparityPrior() if settings.disparity_prior else None
        self._twist_measurement = TwistMeasurement(settings.slip_std, settings.axle_distance)
        self._walk_densities = walk_densities(settings)
        self._state = ErrorState(prior_covariance(settings), SIZE, tape)
        self._marginalized = ImagePointMap(camera)
        self.T_world_body = np.eye(4)
        self.twist = np.zeros(6)
        self.gyro_bias = np.zeros(3)
        self.velocity_bias = np.zeros(2)
        self.kappa = 0.0
        self.keys: Keys = np.empty(0, dtype=np.int64)
        self.image_points: Array = np.empty((0, 3))

    @property
    def covariance(self) -> Array:
        """Covariance (18 + 3 n, 18 + 3 n) of the error state."""
        return self._state.covariance

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error on the right."""
        return self.covariance[POSE, POSE].copy()

    @property
    def active(self) -> int:
        """Number of landmarks in the dense block."""
        return len(self.keys)

    @property
    def landmark_count(self) -> int:
        """Number of landmarks with a position, those marginalized and those tracked."""
        return self._marginalized.count + int(np.count_nonzero(self._has_position()))

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Take a step, in the order of the text above."""
        behind_camera = self.keys[:0]
        self._marginalize(is_member(self.keys, frame.ended))
        parts = [part for part in increment.parts if part.duration > _SHORTEST_STEP]
        if parts:
            self._frame_rate.add(increment.duration)
        for tau, measured in parts:
            before = self._walk(tau)
            if measured is not None:
                self._measure_twist(measured, tau)
            behind_camera = np.concatenate([behind_camera, self._move(tau)])
        slots = indices_of(frame.keys, self.keys)
        known = slots >= 0
        outcome = self._correct(frame.keys[known], slots[known], frame.pixels[known])
        if self._settings.learn_noise and parts and measured is not None and outcome.used:
            self._learn_motion_noise(*before, measured, tau)
        # What is behind the camera is not what is seen: its track begins anew at the next frame.
        contradicted = is_member(frame.keys, behind_camera)
        new = ~(known | contradicted)
        self._initialize(frame.keys[new], frame.pixels[new], frame.copied[new])
        self._state.end_step(self.T_world_body)
        return replace(
            outcome,
            admitted=int(np.count_nonzero(new)),
            rejected=np.concatenate([outcome.rejected, frame.keys[contradicted]]),
            twist=Twist(self.twist, self.covariance[TWIST, TWIST].copy()),
            estimates=self._estimates(),
        )

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""
        keys, means, covariances = self._marginalized.all()
        tracked = np.flatnonzero(self._has_position())
        positions = world_positions(self._camera, self._image_points_of(tracked))
        return (
            np.concatenate([keys, self.keys[tracked]]),
            np.concatenate([means, positions.means]),
            np.concatenate([covariances, positions.covariances]),
        )

    def _marginalize(self, gone: NDArray[np.bool_]) -> None:
        """Leave landmarks (n,) out of the state; those with a position enter the map."""
        if not gone.any():
            return
        keys, points = self.keys[gone], self._image_points_of(np.flatnonzero(gone))
        mapped = has_position(points.y, points.own)
        self._marginalized.add(keys[mapped], points.of(mapped))
        positions = partial(positions_of_all, self._camera, points, mapped)
        self._state.apply(Marginalization(keys, gone, positions))
        self._track_noise.remove(gone)
        self.keys, self.image_points = self.keys[~gone], self.image_points[~gone]

    def _walk(self, tau: float) -> tuple[Array, Array]:
        """``P <- P + Q``; return the twist (6,) and its variances (6,) as they stand then."""
        self._walk_densities[TWIST] = self._motion_noise.walk_variance
        self._state.apply(RandomWalk(np.diag(tau * self._walk_densities)))
        return self.twist, self._state.vehicle_covariance.diagonal()[TWIST].copy()

    def _measure_twist(self, measured: Array, tau: float) -> None:
        """Correct by the prediction's mean twist (6,) over tau seconds."""
        self._motion_noise.add(measured)
        self._twist_variance = self._motion_noise.twist_variance
        error = self._twist_error(measured)
        correction = self._twist_measurement.correction(
            error, self._twist_variance, self.twist, tau
        )
        self._shift(self._state.apply(correction).delta)

    def _twist_error(self, measured: Array) -> Array:
        """What a measured twist (6,) is off from the estimate."""
        return self._twist_measurement.error(
            measured, self.twist, self.gyro_bias, self.velocity_bias
        )

    def _move(self, tau: float) -> Keys:
        """Move the body and warp every landmark; return the keys of those behind the camera."""
        motion = se3.exp(tau * self.twist)
        warped = warp(self._camera, self.image_points, motion)
        behind_camera = self.keys[~warped.ahead]
        if len(behind_camera):
            self._marginalize(~warped.ahead)
            warped = warp(self._camera, self.image_points, motion)
        self._state.apply(
            transition_of(self._camera, self.image_points, warped, motion, self.twist, tau)
        )
        self.T_world_body = self.T_world_body @ motion
        self.image_points = warped.y
        return behind_camera

    def _correct(self, keys: Keys, slots: NDArray[np.int64], pixels: Array) -> Outcome:
        """Correct by observations of active landmarks; marginalize those of outliers."""
        if len(keys) < self._settings.min_observations:
            return Outcome()
        residual = self._straight(pixels) - self.image_points[slots]
        noise = self._track_noise.variances(slots)
        try:
            inliers = self._inliers(slots, residual, noise)
        except scipy.linalg.LinAlgError:
            # Rounding has cost S its positivity. Give these landmarks up rather than the drive.
            self._marginalize(is_member(self.keys, keys))
            return Outcome(rejected=keys)
        residual, noise, rejected = residual[inliers.indices], noise[inliers.indices], keys[:0]
        if len(residual) < len(keys):
            rejected = np.delete(keys, inliers.indices)
            self._marginalize(is_member(self.keys, rejected))
            slots = indices_of(keys[inliers.indices], self.keys)
        if not len(slots):
            return Outcome(rejected=rejected)
        used = self._track_noise.components
        corrected = self._state.apply(
            DirectCorrection(residual[:, used], noise[:, used], slots, used, inliers)
        )
        self._track_noise.update(slots, residual, inliers.inverse.diagonal(), inliers.weighted)
        self._shift(corrected.delta)
        dof = len(inliers.weighted)
        return Outcome(len(slots), rejected=rejected, nis=corrected.nis, nis_dof=dof)

    def _inliers(self, slots: NDArray[np.int64], residual: Array, noise: Array) -> Inliers:
        """Innovations (n, 3) that pass their own gates and agree with all the others."""
        gate = self._track_noise.gate(self._settings.chi2_gate)
        own = self._state.landmark_covariances()[slots]
        expected = self._track_noise.expected(noise, self.image_points[slots])
        np.einsum("nii->ni", own)[:] += expected
        alone = np.flatnonzero(passes_gates(residual, own, gate, self._settings.pixel_gate))
        used = self._track_noise.components
        numbers = alone[:, None], used
        together = DirectCorrection(residual[numbers], noise[numbers], slots[alone], used)
        agreed = deletion_gate(gate, together.residual, together.inverse_in(self._state))
        return agreed._replace(indices=alone[agreed.indices])

    def _learn_motion_noise(
        self, twist_before: Array, variances_before: Array, measured: Array, tau: float
    ) -> None:
        """Learn the noise of the motion from a step of tau seconds that vision has seen."""
        P, H = self._state.vehicle_covariance, self._twist_measurement.H[:6]
        change, variances = self.twist - twist_before, P.diagonal()[TWIST]
        unexplained = self._twist_error(measured) ** 2 + np.sum((H @ P) * H, axis=1)
        self._motion_noise.update(change, variances_before, variances, unexplained, tau)

    def _initialize(self, keys: Keys, pixels: Array, copied: NDArray[np.bool_]) -> None:
        """Add landmarks at their first observation."""
        if not len(keys):
            return
        y = self._straight(pixels)
        self._track_noise.initialize_level(self._observation.row_mismatch(pixels))
        noise = self._track_noise.of_new_tracks(y)
        # A track that begins at a copied pixel has the disparity of the point it stood for before.
        stale = self._settings.stale_disparity * np.abs(y[:, 0] - y[:, 1])
        noise[copied, 1, 1] += stale[copied] ** 2
        if self._disparity_prior is not None:
            y, noise = self._disparity_prior.apply(y, noise)
        self._state.apply(Initialization(noise))
        self._track_noise.add(len(keys))
        self.keys = np.concatenate([self.keys, keys])
        self.image_points = np.concatenate([self.image_points, y])

    def _shift(self, delta: Array) -> None:
        """Move the estimate by an error (D,)."""
        self.T_world_body = self.T_world_body @ se3.exp(delta[POSE])
        self.twist = self.twist + delta[TWIST]
        self.gyro_bias = self.gyro_bias + delta[GYRO_BIAS]
        self.velocity_bias = self.velocity_bias + delta[VELOCITY_BIAS]
        self.kappa += float(delta[LENS])
        change = delta[SIZE:].reshape(-1, 3)
        change += delta[LENS] * radial_shift(self._camera, self.image_points)
        self.image_points = self.image_points + change

    def _straight(self, pixels: Array) -> Array:
        """Observed image points (n, 3), freed of distortion."""
        y = self._observation.image_points(pixels)
        return y + self.kappa * radial_shift(self._camera, y)

    def _image_points_of(self, slots: NDArray[np.int64]) -> ImagePoints:
        P = self._state.covariance
        return ImagePoints(
            y=self.image_points[slots],
            own=self._state.landmark_covariances()[slots],
            cross=P[self._state.rows_of(slots)[:, :, None], POSE_AND_LENS],
            pose_and_lens=P[POSE_AND_LENS[:, None], POSE_AND_LENS],
            T_world_body=self.T_world_body,
        )

    def _has_position(self) -> NDArray[np.bool_]:
        return has_position(self.image_points, self._state.landmark_covariances())

    def _estimates(self) -> tuple[Estimate, ...]:
        """What else is in the vehicle's state, and the noise as it is learned."""
        std = np.sqrt(np.maximum(self._state.vehicle_covariance.diagonal(), 0.0))
        pixel_variance = self._track_noise.level * sum(self._settings.pixel_variance) / 4
        twist_noise_std = np.sqrt(self._twist_variance)
        walk_std = np.sqrt(self._motion_noise.walk_variance)
        return (
            Estimate(quantities.GYRO_BIAS, self.gyro_bias, std[GYRO_BIAS]),
            Estimate(quantities.VELOCITY_BIAS, self.velocity_bias, std[VELOCITY_BIAS]),
            Estimate(quantities.LENS_DISTORTION, self.kappa, std[LENS]),
            Estimate(quantities.PIXEL_NOISE_STD, pixel_variance**0.5),
            Estimate(quantities.VELOCITY_NOISE_STD, twist_noise_std[0]),
            Estimate(quantities.ANGULAR_VELOCITY_NOISE_STD, twist_noise_std[3]),
            Estimate(quantities.VELOCITY_WALK_STD, walk_std[:3]),
            Estimate(quantities.ANGULAR_VELOCITY_WALK_STD, walk_std[3:]),
        )


register_estimator(
    "robocentric",
    RobocentricSettings,
    lambda settings, given: RobocentricFilter(settings, given.camera, given.tape),
    smoothable=True,
    # Its noise of the motion is the walk of the twist in its state.
    unused=("process_noise", "process_variance"),
)
