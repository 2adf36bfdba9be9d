# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The robocentric filter in its plainest form, to measure the fast one by.

One dense covariance over the vehicle state, every landmark ever seen and every past pose (a clone
that is never observed or moved), textbook equations and an explicit inverse: no active set, no
adjoints, four rows for an observation. Its Jacobians are taken by complex steps from plain
functions (see plain_image_points), exact to rounding, and share nothing with the filter's own.
"""

import copy
from typing import NamedTuple

import numpy as np
from dense_state import BIAS, DRIFT, LENS, POSE, TWIST, DenseState, S
from numpy.typing import NDArray
from plain_belief import Told, told_of_both
from plain_gates import agreeing, distance, given_others, scales_with_tails, stated_factors
from plain_image_points import (
    FOUR_ROWS,
    complex_step,
    homogeneous,
    image_points_of,
    noise_of_image_points,
    pose_transition,
    shift,
    warped,
)

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.linalg.gating import passes_gates
from vislam_ros.core.motion import Increment
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.motion_noise import MotionNoise
from vislam_ros.core.noise.track_noise import TrackNoise
from vislam_ros.core.tracking.tracked_frame import TrackedFrame

Array = NDArray[np.float64]


class Shown(NamedTuple):
    """By how much a frame shows the vehicle to be off, its covariance, and how many agree."""

    delta: Array
    P: Array
    agreed: int
    seen: int


class DenseRobocentricFilter(DenseState):
    """EKF over ``[vehicle; delta_1; ...; delta_N]`` where each delta is a landmark's or a clone's.

    Parameters
    ----------
    settings, camera
        As the filter's.
    exchange : bool
        Whether an ended landmark's image point is exchanged for its world position, a linear
        change of three variables, where it has one; if not, the motion goes on to warp it until
        it has passed the camera.
    clone_poses : bool
    """

    def __init__(
        self,
        settings: RobocentricSettings,
        camera: StereoCamera,
        *,
        exchange: bool = False,
        clone_poses: bool = False,
    ):
        bias, lens = settings.gyro_bias_std**2, settings.lens_distortion_std**2
        prior = [settings.prior_pose_variance, 50.0**2, 2.0**2, bias, lens, 0.0]
        super().__init__(camera, np.repeat(prior, [6, 3, 3, 3, 1, 3]))
        self.settings = settings
        self.exchange = exchange
        self.clone_poses = clone_poses
        self.told_V: Array = np.diag(settings.pixel_variance)
        self.frame_rate = FrameRate()
        self.motion_noise = MotionNoise(
            np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3),
            np.repeat([settings.velocity_walk_std, settings.angular_velocity_walk_std], 3),
            self.frame_rate,
        )
        self.track_noise = TrackNoise(
            np.diag(noise_of_image_points(self.told_V)).copy(),
            settings.disparity_offset_std,
            self.frame_rate,
            learns=settings.learn_noise,
        )
        self.twist_variance = self.motion_noise.twist_variance
        # Sums of whitened innovations, by key, and of how many frames.
        self.runs: dict[int, tuple[Array, int]] = {}
        # Keys in the order of the track noise.
        self.judged: list[int] = []
        self.doubted = np.zeros(6, dtype=bool)
        self.saw_nothing = self.told_twist = False
        self.rejected: list[int] = []

    def step(self, increment: Increment, frame: TrackedFrame) -> list[int]:
        """Take a frame; return the keys whose observations failed a gate."""
        gone = [*frame.ended.tolist(), *self.rejected]
        self.marginalize([key for key in gone if key in self.place_of_key])
        now = self.P.diagonal()[TWIST]
        doubted = np.minimum(100.0 * now, np.repeat([50.0**2, 2.0**2], 3))
        self.P[TWIST, TWIST] += np.diag(self.doubted * np.maximum(doubted - now, 0.0))
        if increment.duration > 0:
            self.frame_rate.add(increment.duration)
        for i, (tau, measured) in enumerate(increment.parts):
            twist, variances = self.walk(tau)
            belied = struck = False
            if measured is not None and len(increment.parts) == 1:
                belied, struck = self.belied(measured, frame, tau)
            used = None if belied else measured
            if used is not None:
                self.measure_twist(used, may_jump=i > 0 or self.saw_nothing or struck)
            is_measured = used is not None and bool(np.isfinite(used).all())
            is_last = i == len(increment.parts) - 1
            is_known = self.told_twist or is_measured or not is_last
            shown = None if is_known else self.shown(frame, tau)
            self.move(tau, None if shown is None else self.estimate[TWIST] + shown.delta[TWIST])
        keys = frame.keys.tolist()
        self.saw_nothing = not keys
        known = [i for i, key in enumerate(keys) if key in self.place_of_key]
        new = [i for i, key in enumerate(keys) if key not in self.place_of_key]
        rejected = []
        factors = stated_factors(self.track_noise, frame, self.told_V[0, 0])
        if known:
            rejected = self.correct([keys[i] for i in known], frame.pixels[known], factors[known])
        self.rejected = rejected
        self.told_twist = len(rejected) < len(known)
        self.doubted = np.full(6, bool(rejected) and 2 * len(rejected) >= len(known))
        if increment.parts and len(rejected) < len(known):
            change, after = self.estimate[TWIST] - twist, np.diag(self.P)[TWIST].copy()
            learns = self.settings.learn_noise
            if learns and measured is not None:
                H = self.twist_rows()
                error = np.asarray(measured) - H @ self.estimate
                error_variance = np.diag(H @ self.P @ H.T).copy()
                seen = change, variances, after, error, error_variance, tau
                self.motion_noise.update(*seen, is_used=used is not None)
            foreseen = np.maximum(variances - after, 0.0)
            self.doubted |= (learns and self.motion_noise.begins) | (change**2 > 9.0 * foreseen)
        self.initialize([keys[i] for i in new], frame.pixels[new], factors[new])
        if self.clone_poses:
            self.clones.append((self.T_world_body, len(self.P)))
            self.augment(np.eye(6, S), np.zeros((6, 6)), np.zeros(6))
        return rejected

    def walk(self, tau: float) -> tuple[Array, Array]:
        """Let twist and bias change, and vision drift; return the twist and its variances then."""
        settings = self.settings
        self.estimate[DRIFT] = 0.0
        self.P[DRIFT] = self.P[:, DRIFT] = 0.0
        in_common = self.track_noise.observations_per_independent - 1
        speed = np.linalg.norm(self.estimate[TWIST][:3])
        self.P[DRIFT, DRIFT] = in_common * 0.13e-3**2 * speed / tau * np.eye(3)
        self.P[TWIST, TWIST] += tau * np.diag(self.motion_noise.walk_variance)
        self.P[BIAS, BIAS] += settings.gyro_bias_walk_std**2 * tau * np.eye(3)
        return self.estimate[TWIST].copy(), np.diag(self.P)[TWIST].copy()

    def measure_twist(self, measured: Array, *, may_jump: bool) -> None:
        self.motion_noise.add(measured)
        self.twist_variance = self.motion_noise.twist_variance
        known = np.flatnonzero(np.isfinite(measured))
        H = self.twist_rows()[known]
        R = np.diag(self.twist_variance[known])
        error = measured[known] - H @ self.estimate
        S = np.diag(H @ self.P @ H.T + R)
        more = may_jump & (error**2 > 9 * S)
        self.P[6 + known, 6 + known] += np.where(more, error**2 - S, 0.0)
        self.update(H, R, error)

    def body_twist_rows(self) -> Array:
        H = np.zeros((6, len(self.P)))
        H[:, TWIST] = np.eye(6)
        H[3:, DRIFT] = -np.eye(3)
        return H

    def twist_rows(self) -> Array:
        H = self.body_twist_rows()
        H[3:, BIAS] = np.eye(3)
        return H

    def belied(self, measured: Array, frame: TrackedFrame, tau: float) -> tuple[bool, bool]:
        """Whether the frame belies a measured twist, and the one before it, but not both."""
        gate, known = self.settings.chi2_gate, np.flatnonzero(np.isfinite(measured))
        H = self.twist_rows()[known, :S]
        R = np.diag(self.twist_variance[known])
        error, P = measured[known] - H @ self.estimate[:S], self.P[:S, :S]
        if gate == 0 or not np.any(error**2 > 9 * np.diag(H @ P @ H.T + R)):
            return False, False
        alone = copy.deepcopy(self)
        unknown = np.repeat([50.0**2, 2.0**2], 3)
        alone.P[TWIST, TWIST] += np.diag(np.maximum(unknown - np.diag(P)[TWIST], 0.0))
        shown = alone.shown(frame, tau)
        numbers = 0 if shown is None else shown.agreed * len(self.track_noise.components)
        if shown is None or 2 * shown.agreed <= shown.seen or numbers <= 6:
            return False, False
        of_measured = error - H @ shown.delta, H @ shown.P @ H.T + R
        of_twist = shown.delta[TWIST], shown.P[TWIST, TWIST] + P[TWIST, TWIST]
        # Velocity, where it is measured, and angular velocity each for itself.
        far = [
            (
                distance(*of_measured, slice(k, k + 3)) > gate,
                distance(*of_twist, slice(6 - len(known) + k, 9 - len(known) + k)) > gate,
            )
            for k in range(0, len(known), 3)
        ]
        return (True, False) in far, (False, True) in far

    def shown(self, frame: TrackedFrame, tau: float) -> Shown | None:
        """What the frame shows of the vehicle after a motion by its twist, if that loses none."""
        after = copy.deepcopy(self)
        after.move(tau)
        keys = [key for key in frame.keys.tolist() if key in self.place_of_key]
        if not keys or len(after.place_of_key) < len(self.place_of_key):
            return None
        known = np.isin(frame.keys, keys)
        factors = stated_factors(self.track_noise, frame, self.told_V[0, 0])[known]
        rows, residual, _, joint, agreed = after.innovations(keys, frame.pixels[known], factors)
        told = self.track_noise.components
        numbers = (3 * np.array(agreed, dtype=int)[:, None] + told).ravel()
        told_numbers = (
            len(told) * np.array(agreed, dtype=int)[:, None] + np.arange(len(told))
        ).ravel()
        P_xz = after.P[:S][:, rows.ravel()[numbers]]
        gain = P_xz @ np.linalg.inv(joint[np.ix_(told_numbers, told_numbers)])
        left = after.P[:S, :S] - gain @ P_xz.T
        return Shown(gain @ residual.ravel()[numbers], left, len(agreed), len(keys))

    def move(self, tau: float, about: Array | None = None) -> None:
        """Move, all linearized about another twist than the one believed, where it is given."""
        off = np.zeros(6) if about is None else self.estimate[TWIST] - about
        self.estimate[TWIST] -= off
        F = self.moved_by_the_twist(tau)
        error = np.zeros(len(self.P))
        error[TWIST] = off
        self.take_out(F @ error)

    def moved_by_the_twist(self, tau: float) -> Array:
        """Move; return F."""
        camera, estimate = self.camera, self.estimate
        self.leave_out_of_view()
        rows = self.rows_of(self.warped_places)
        _, ahead = warped(camera, estimate[rows], estimate[TWIST], tau)
        lost = {place for place, good in zip(self.warped_places, ahead, strict=True) if not good}
        self.marginalize([key for key, place in self.place_of_key.items() if place in lost])
        self.warped_places = [place for place in self.warped_places if place not in lost]

        rows = self.rows_of(self.warped_places)
        y, twist = estimate[rows], estimate[TWIST]
        y_new = warped(camera, y, twist, tau)[0].real
        D, D_new = shift(camera, y).real, shift(camera, y_new).real
        body_twist = self.body_twist_rows() @ estimate
        motion = se3.exp(tau * body_twist)
        F = np.eye(len(self.P))
        F[POSE, :12] = pose_transition(body_twist, tau)
        F[POSE, DRIFT] = -F[POSE, TWIST][:, 3:]
        by_twist = complex_step(lambda u: warped(camera, y, u, tau)[0], twist)
        # The true point is y + delta + D delta_kappa, before as after.
        by_lens = complex_step(
            lambda k: warped(camera, y + k[0] * D, twist, tau)[0] - k[0] * D_new, np.zeros(1)
        )
        by_own = complex_step(lambda d: warped(camera, y + d, twist, tau)[0], np.zeros(3))
        for i, own in enumerate(rows):
            F[own, TWIST] = by_twist[i]
            F[own, LENS] = by_lens[i, :, 0]
            F[np.ix_(own, own)] = by_own[i]
        self.P = F @ self.P @ F.T
        self.T_world_body = self.T_world_body @ motion
        self.estimate[rows] = y_new
        return F

    def leave_out_of_view(self) -> None:
        """Let ended landmarks rest where no lens could show them: its polynomial is none there."""
        in_use = set(self.place_of_key.values())
        y = self.estimate[self.rows_of(self.warped_places)]
        ray = homogeneous(self.camera, y)[:, :2].real
        self.warped_places = [
            place
            for place, seen in zip(self.warped_places, np.abs(ray).max(axis=1) < 1.5, strict=True)
            if seen or place in in_use
        ]

    def innovations(
        self, keys: list[int], pixels: Array, factors: Array
    ) -> tuple[NDArray[np.int64], Array, Array, Array, list[int]]:
        """Rows, residuals, variances and joint covariance of what is seen, and which agree."""
        noise = self.track_noise
        rows = self.rows_of([self.place_of_key[key] for key in keys])
        slots = np.array([self.judged.index(key) for key in keys])
        variances = noise.variances(slots, factors)
        z = image_points_of(pixels, self.told_V)
        residual = z + self.estimate[LENS] * shift(self.camera, z).real - self.estimate[rows]
        expected = noise.expected(variances, self.estimate[rows])
        pairs = zip(rows, expected, strict=True)
        own = np.array([self.P[np.ix_(row, row)] + np.diag(R) for row, R in pairs])
        gate = noise.gate(self.settings.chi2_gate)
        passes = passes_gates(residual, own, gate, self.settings.pixel_gate)
        told = noise.components
        places = rows[:, told].ravel()
        joint = self.P[np.ix_(places, places)] + np.diag(variances[:, told].ravel())
        agreed = agreeing(gate, residual[:, told], joint, np.flatnonzero(passes).tolist())
        return rows, residual, variances, joint, agreed

    def correct(self, keys: list[int], pixels: Array, factors: Array) -> list[int]:
        noise, told = self.track_noise, self.track_noise.components
        rows, residual, variances, joint, agreed = self.innovations(keys, pixels, factors)
        z, gate = image_points_of(pixels, self.told_V), noise.gate(self.settings.chi2_gate)
        kept = self.that_stay(gate, keys, residual[:, told], joint, agreed)
        rejected = np.delete(keys, kept).tolist()
        R_0 = noise.level * np.outer(factors, np.diag(noise_of_image_points(self.told_V)))
        scales = variances[:, 0] / R_0[:, 0]
        if self.settings.learn_noise:
            scales = scales_with_tails(residual[:, told], joint, kept, R_0[:, told], scales)
        # Of four rows, or three where the right pixel tells nothing, each with its own noise.
        used = FOUR_ROWS[:, told].any(axis=1)
        some_rows = FOUR_ROWS[np.ix_(used, told)]
        r = len(some_rows)
        H = np.zeros((r * len(kept), len(self.P)))
        R = np.zeros((len(H), len(H)))
        for i, k in enumerate(kept):
            own_rows = slice(r * i, r * i + r)
            H[own_rows, rows[k, told]] = some_rows
            V = noise.level * factors[k] * scales[k] * self.told_V
            R[own_rows, own_rows] = V[np.ix_(used, used)]
        # What the numbers leave of the rows is noise alone.
        left = (pixels[kept] - z[kept] @ FOUR_ROWS.T)[:, used]
        innovation = (residual[kept][:, told] @ some_rows.T + left).ravel()
        if len(H):
            each = np.kron(np.eye(len(kept)), some_rows)
            S_inverse = np.linalg.inv(H @ self.P @ H.T + R)
            information = np.diag(each.T @ S_inverse @ each).copy()
            slots = np.array([self.judged.index(keys[k]) for k in kept])
            told_of = slots, residual[kept], variances[kept]
            noise.update(*told_of, information, each.T @ S_inverse @ innovation)
            self.update(H, R, innovation)
        return rejected

    def that_stay(
        self, gate: float, keys: list[int], residual: Array, S: Array, agreed: list[int]
    ) -> list[int]:
        """Which of the innovations that agree stay, with all that their tracks had before."""
        told, still = self.track_noise.components, []
        for i in agreed:
            error, C = given_others(residual, S, agreed, i)
            L = np.linalg.cholesky(np.linalg.inv(C))
            total, frames = self.runs[keys[i]]
            total[told] += L.T @ error
            self.runs[keys[i]] = total, frames + 1
            distance = total[told] @ total[told] / (frames + 1)
            if gate == 0 or distance <= gate:
                still.append(i)
        return still

    def initialize(self, keys: list[int], pixels: Array, factors: Array) -> None:
        z = image_points_of(pixels, self.told_V)
        points = z + self.estimate[LENS] * shift(self.camera, z).real
        spread = np.sqrt(factors * (self.told_V[1, 1] + self.told_V[3, 3]))
        self.track_noise.initialize_level((pixels[:, 1] - pixels[:, 3]) / spread)
        noises = self.track_noise.of_new_tracks(points, factors)
        for key, y, noise in zip(keys, points, noises, strict=True):
            self.track_noise.add(1)
            self.judged.append(key)
            self.runs[key] = np.zeros(3), 0
            self.place_of_key[key] = len(self.P)
            self.warped_places.append(len(self.P))
            self.augment(np.zeros((3, S)), noise, y)

    def marginalize(self, keys: list[int]) -> None:
        """Observe landmarks no more."""
        self.track_noise.remove(np.isin(np.array(self.judged, dtype=np.int64), keys))
        self.judged = [key for key in self.judged if key not in keys]
        told = self.told()
        for key in keys:
            place = self.place_of_key[key]
            if self.has_position(place):
                self.mapped[key] = self.landmark(key, told)
            if self.exchange and self.has_position(place):
                own = self.rows_of([place])[0]
                position, J = self.position(self.estimate[own], self.T_world_body)
                rows = np.concatenate([np.arange(S), own])
                self.P[own] = J @ self.P[rows]
                self.P[:, own] = self.P[:, rows] @ J.T
                self.estimate[own] = position
                self.warped_places.remove(place)
                self.positions_of_key[key] = place
            del self.place_of_key[key]

    def told(self) -> Told:
        """Weigh bias and none."""
        prior, temper = (
            self.settings.gyro_bias_std**2,
            self.track_noise.observations_per_independent,
        )
        return told_of_both(self.P, BIAS, self.estimate[BIAS], prior, temper)
