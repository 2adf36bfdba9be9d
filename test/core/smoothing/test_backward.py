# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The backward pass ends where filters that keep everything in their state end."""

import numpy as np
import pytest
from dense_reference import DenseJointFilter
from numpy.typing import NDArray
from tracked_drive import gappy_drive, run, trying_drive

from vislam_ros.core.filters.joint import JointFilter
from vislam_ros.core.geometry import se3
from vislam_ros.core.linalg.linear_update import Scratch
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.smoothing import tape
from vislam_ros.core.smoothing.backward import Smoothed, smooth
from vislam_ros.core.smoothing.error_operations import (
    Admission,
    Correction,
    DirectCorrection,
    Operation,
    PoseMark,
    RandomWalk,
    Retirement,
    Transition,
)
from vislam_ros.core.smoothing.tape import Tape
from vislam_ros.data.drive import Drive
from vislam_ros.data.simulation.simulate import SimulationSettings

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def drive() -> Drive:
    return trying_drive(steps=40, landmarks=240, seed=5)


def settings_of(**changes: object) -> SlamSettings:
    settings = {
        "min_disparity": 6.0,
        "retire_after": 2,
        "velocity_noise_std": 0.1,
        "angular_velocity_noise_std": 0.01,
        "prior_pose_variance": 1e-4,
        **changes,
    }
    return SlamSettings(**settings)  # type: ignore[arg-type]


def record(drive: Drive, settings: SlamSettings) -> tuple[JointFilter, Tape]:
    recorded = Tape(JointFilter.SMALL_SIZE)
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
    recorded = Tape(JointFilter.SMALL_SIZE)
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
    # There was something to do: landmarks stood elsewhere when they were set aside.
    set_aside = filter_.landmarks()[1][: len(smoothed.keys)]
    assert np.abs(smoothed.positions - set_aside).max() > 0.1


def test_recording_leaves_the_filter_as_it_is(drive: Drive) -> None:
    recorded, _ = record(drive, settings_of())
    plain = JointFilter(settings_of(), drive.camera)
    for _ in run(plain, drive, settings_of()):
        pass
    np.testing.assert_array_equal(recorded.T_world_body, plain.T_world_body)
    np.testing.assert_array_equal(recorded.covariance, plain.covariance)


def test_the_covariance_carried_over_a_stretch_is_the_filters(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tape, "_STEPS_IN_A_STRETCH", 7)
    _, recorded = record(drive, settings_of())
    assert len(recorded.stretches) == 6
    for stretch, following in zip(recorded.stretches[:-1], recorded.stretches[1:], strict=True):
        P, scratch = stretch.covariance.copy(), Scratch()
        for operation in stretch.operations:
            P, _ = operation.carry(P, recorded.small_size, scratch)
        np.testing.assert_allclose(P, following.covariance, rtol=0, atol=1e-9)


def test_the_length_of_a_stretch_does_not_matter(
    drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = smooth(record(drive, settings_of())[1])
    monkeypatch.setattr(tape, "_STEPS_IN_A_STRETCH", 3)
    pieces = smooth(record(drive, settings_of())[1])
    np.testing.assert_array_equal(pieces.keys, whole.keys)
    for name in ("poses", "pose_covariances", "positions", "covariances"):
        np.testing.assert_allclose(
            getattr(pieces, name), getattr(whole, name), rtol=0, atol=1e-9, err_msg=name
        )


def test_a_tape_can_be_smoothed_while_the_drive_goes_on(drive: Drive) -> None:
    settings = settings_of()
    recorded = Tape(JointFilter.SMALL_SIZE)
    filter_ = JointFilter(settings, drive.camera, recorded)
    for k, _ in enumerate(run(filter_, drive, settings)):
        if k == 20:
            midway = smooth(recorded)
            assert len(midway.poses) == 21
            np.testing.assert_allclose(midway.poses[-1], filter_.T_world_body, rtol=0, atol=1e-12)
    undisturbed = smooth(record(drive, settings)[1])
    np.testing.assert_array_equal(smooth(recorded).positions, undisturbed.positions)


def test_an_empty_tape_gives_nothing() -> None:
    smoothed = smooth(Tape(6))
    assert smoothed.poses.shape == (0, 4, 4)
    assert smoothed.pose_covariances.shape == (0, 6, 6)
    assert smoothed.positions.shape == (0, 3)
    assert smoothed.covariances.shape == (0, 3, 3)


def test_covariances_stay_positive_and_never_grow_over_a_long_drive_with_far_landmarks() -> None:
    drive = gappy_drive(SimulationSettings(steps=400, landmarks=1500, seed=5, frozen_share=0.1))
    settings = settings_of(min_disparity=1.0)
    filter_, recorded = record(drive, settings)
    smoothed = smooth(recorded)
    set_aside = filter_.landmarks()[2][: len(smoothed.keys)]
    scale = np.trace(set_aside, axis1=1, axis2=2)[:, None]
    assert scale.max() > 1e4
    assert np.all(np.linalg.eigvalsh(smoothed.covariances) > 0)
    assert np.all(np.linalg.eigvalsh(set_aside - smoothed.covariances) > -1e-9 * scale)
    assert np.all(np.linalg.eigvalsh(smoothed.pose_covariances) > 0)


class KeepingFilter:
    """Applies operations to a covariance that keeps all that has left the error state, or was
    marked, behind it. It reads the operations' fields and uses none of their methods.
    """

    def __init__(self, P: Array, s: int):
        self.s, self.size = s, len(P)
        self.P = P
        self.kept: list[tuple[Operation, Array]] = []
        """Each retirement or mark, and the estimates of what it keeps."""

    def apply(self, operation: Operation) -> None:
        D, s, total = self.size, self.s, len(self.P)
        if isinstance(operation, Transition):
            F = np.eye(total)
            F[:s, :s] = operation.small
            for i in range((D - s) // 3):
                own = slice(s + 3 * i, s + 3 * i + 3)
                if operation.landmarks is not None:
                    F[own, own] = operation.landmarks[i]
                if operation.coupling is not None:
                    F[own, 6:s] = operation.coupling[i]
            self.P = F @ self.P @ F.T
        elif isinstance(operation, RandomWalk):
            self.P[:s, :s] += operation.noise
        elif isinstance(operation, Correction):
            n, r = operation.residual.shape
            H: Array = np.zeros((n, r, total))
            R: Array = np.zeros((n, r, n, r))
            for i in range(n):
                if operation.H_small is not None:
                    H[i, :, :s] = operation.H_small[i]
                if operation.H_landmark is not None and operation.slots is not None:
                    place = s + 3 * operation.slots[i]
                    H[i, :, place : place + 3] = operation.H_landmark[i]
                R[i, :, i] = operation.noise if operation.noise.ndim == 2 else operation.noise[i]
            H, R = H.reshape(n * r, total), R.reshape(n * r, n * r)
            self._update(H, R, operation.residual.ravel())
        elif isinstance(operation, DirectCorrection):
            rows = (s + 3 * operation.slots[:, None] + operation.components).ravel()
            R = np.diag(operation.noise.ravel())
            self._update(np.eye(total)[rows], R, operation.residual.ravel())
        elif isinstance(operation, Retirement):
            J = np.zeros((3 * len(operation.keys), total))
            for i, slot in enumerate(np.flatnonzero(operation.gone)):
                own, place = slice(3 * i, 3 * i + 3), s + 3 * slot
                J[own, place : place + 3] = np.eye(3)
                if operation.J_landmark is not None:
                    J[own, place : place + 3] = operation.J_landmark[i]
                if operation.J_small is not None:
                    J[own, :s] = operation.J_small[i]
            self._keep(operation, J, operation.positions.ravel())
            stays = np.ones(len(self.P), dtype=bool)
            stays[s:D] = np.repeat(~operation.gone, 3)
            self.P = self.P[np.ix_(stays, stays)]
            self.size -= int(np.sum(~stays))
        elif isinstance(operation, Admission):
            m = 3 * len(operation.noise)
            grow = np.zeros((total + m, total))
            grow[:D, :D] = np.eye(D)
            grow[D + m :, D:] = np.eye(total - D)
            if operation.J is not None:
                grow[D : D + m, :s] = operation.J.reshape(m, s)
            self.P = grow @ self.P @ grow.T
            for i, noise in enumerate(operation.noise):
                own = slice(D + 3 * i, D + 3 * i + 3)
                self.P[own, own] += noise
            self.size += m
        else:
            self._keep(operation, np.eye(6, total), np.zeros(6))

    def _update(self, H: Array, R: Array, residual: Array) -> None:
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        shift = K @ residual
        self.P = self.P - K @ H @ self.P
        place = self.size
        for _, estimate in self.kept:
            estimate += shift[place : place + len(estimate)]
            place += len(estimate)

    def _keep(self, operation: Operation, J: Array, estimate: Array) -> None:
        grow = np.vstack([np.eye(len(self.P)), J])
        self.P = grow @ self.P @ grow.T
        self.kept.append((operation, estimate.copy()))

    def smoothed(self) -> Smoothed:
        landmarks, marks = [], []
        place = self.size
        for operation, estimate in self.kept:
            own = slice(place, place + len(estimate))
            if isinstance(operation, PoseMark):
                marks.append((operation.T_world_body @ se3.exp(estimate), self.P[own, own]))
            elif isinstance(operation, Retirement):
                for i, key in enumerate(operation.keys):
                    part = slice(place + 3 * i, place + 3 * i + 3)
                    landmarks.append((key, estimate[3 * i : 3 * i + 3], self.P[part, part]))
            place = own.stop
        return Smoothed(
            *(np.array(parts) for parts in zip(*marks, strict=True)),
            *(np.array(parts) for parts in zip(*landmarks, strict=True)),
        )


def random_positive(rng: np.random.Generator, *shape: int) -> Array:
    A = rng.standard_normal(shape)
    return A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(shape[-1])


def random_operations(rng: np.random.Generator, s: int, steps: int) -> list[list[Operation]]:
    """Every kind of operation in every form, step by step, in any order within a step."""
    n, key = 0, 0
    course: list[list[Operation]] = []
    for _ in range(steps):
        done: list[Operation] = []
        for kind in rng.permutation(5):
            some = rng.random() < 0.7
            if kind == 0:
                F = np.eye(s) + 0.2 * rng.standard_normal((s, s))
                blocks = np.eye(3) + 0.2 * rng.standard_normal((n, 3, 3))
                coupling = 0.3 * rng.standard_normal((n, 3, s - 6))
                done.append(
                    Transition(F, blocks if some else None, coupling if some and n % 2 else None)
                )
                done.append(RandomWalk(0.01 * random_positive(rng, s, s)))
            elif kind == 1 and n:
                seen = rng.permutation(n)[: rng.integers(1, n + 1)]
                r = int(rng.integers(2, 5))
                H_small = rng.standard_normal((len(seen), r, s)) if some else None
                H_landmark = rng.standard_normal((len(seen), r, 3))
                noise = random_positive(rng, *((len(seen), r, r) if some else (r, r)))
                residual = rng.standard_normal((len(seen), r))
                done.append(Correction(residual, noise, H_small, H_landmark, seen))
                # Their own numbers, of some of them or of all.
                seen = np.arange(n) if some else seen
                components = np.sort(rng.permutation(3)[: rng.integers(2, 4)])
                residual = rng.standard_normal((len(seen), len(components)))
                noise = rng.uniform(0.3, 2.0, residual.shape)
                done.append(DirectCorrection(residual, noise, seen, components))
                # A measurement of the small part alone, of more rows than it has.
                H_small = rng.standard_normal((1, s + 1, s))
                noise = random_positive(rng, s + 1, s + 1)
                done.append(Correction(rng.standard_normal((1, s + 1)), noise, H_small))
            elif kind == 2 and n:
                gone = rng.random(n) < 0.3
                gone[rng.integers(n)] = True
                m = int(gone.sum())
                J_small = rng.standard_normal((m, 3, s)) if some else None
                J_landmark = rng.standard_normal((m, 3, 3)) if some else None
                positions = rng.standard_normal((m, 3))
                keys = np.arange(key, key + m)
                done.append(Retirement(keys, positions, gone, J_small, J_landmark))
                n, key = n - m, key + m
            elif kind == 3:
                m = int(rng.integers(1, 4))
                J = rng.standard_normal((m, 3, s)) if some else None
                done.append(Admission(random_positive(rng, m, 3, 3), J))
                n += m
            elif kind == 4:
                done.append(PoseMark(se3.exp(rng.standard_normal(6))))
        course.append(done)
    return course


@pytest.mark.parametrize("s", [6, 15])
@pytest.mark.parametrize("seed", range(5))
def test_any_operations_give_what_a_filter_that_keeps_all_gives(s: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    P = random_positive(rng, s, s)
    reference, recorded, scratch = KeepingFilter(P, s), Tape(s), Scratch()
    carried = P.copy()
    for step in random_operations(rng, s, 12):
        recorded.begin_step(carried)
        for operation in step:
            recorded.record(operation)
            reference.apply(operation)
            carried, _ = operation.carry(carried, s, scratch)
    exact, smoothed = reference.smoothed(), smooth(recorded)
    np.testing.assert_allclose(
        carried, reference.P[: reference.size, : reference.size], rtol=1e-9, atol=1e-9
    )
    np.testing.assert_array_equal(smoothed.keys, exact.keys)
    for name in ("poses", "pose_covariances", "positions", "covariances"):
        np.testing.assert_allclose(
            getattr(smoothed, name), getattr(exact, name), rtol=1e-9, atol=1e-9, err_msg=name
        )


def test_a_tape_is_not_changed_by_what_its_filter_does_to_its_arrays() -> None:
    recorded = Tape(6)
    P, F = np.eye(6), 2 * np.eye(6)
    recorded.begin_step(P)
    recorded.record(Transition(F))
    P[:], F[:] = 0, 0
    (stretch,) = recorded.stretches
    carried, _ = stretch.operations[0].carry(stretch.covariance, 6, Scratch())
    np.testing.assert_array_equal(carried, 4 * np.eye(6))
