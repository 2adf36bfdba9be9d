# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Any operations in any order, there and back, are those of a filter that keeps all."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from keeping_filter import KeepingFilter
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.operations.correction import Correction, VehicleCorrection
from vislam_ros.core.operations.direct_correction import DirectCorrection
from vislam_ros.core.operations.error_state import ErrorState, Operation, PoseMark
from vislam_ros.core.operations.initialization import Initialization
from vislam_ros.core.operations.marginalization import Marginalization, WorldPositions
from vislam_ros.core.operations.transition import (
    NewBeginning,
    RandomWalk,
    Transition,
    VehicleTransition,
)
from vislam_ros.core.smoothing.backward import smooth
from vislam_ros.core.smoothing.tape import Tape

Array = NDArray[np.float64]


def random_positive(rng: np.random.Generator, *shape: int) -> Array:
    A = rng.standard_normal(shape)
    return A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(shape[-1])


class RandomCourse:
    """Draws operations, each in any of its forms."""

    def __init__(self, rng: np.random.Generator, s: int):
        self.rng, self.s = rng, s
        self.landmarks = 0
        self.next_key = 0

    def step(self) -> list[Operation[Any]]:
        """Some of each kind, in any order."""
        done: list[Operation[Any]] = []
        kinds = [self.motion, self.corrections, self.leave, self.join]
        for kind in self.rng.permutation(len(kinds)):
            done += kinds[kind]()
        return done

    def motion(self) -> list[Operation[Any]]:
        rng, s, n = self.rng, self.s, self.landmarks
        A = np.eye(s) + 0.2 * rng.standard_normal((s, s))
        D = np.eye(3) + 0.2 * rng.standard_normal((n, 3, 3))
        C = 0.3 * rng.standard_normal((n, 3, s - 6))
        moved = Transition(A, D, C) if rng.random() < 0.7 else VehicleTransition(A)
        # A measurement of the vehicle state alone, of more rows than it has.
        measured = VehicleCorrection(
            rng.standard_normal(s + 1),
            rng.uniform(0.3, 2.0, s + 1),
            rng.standard_normal((s + 1, s)),
        )
        begun = [NewBeginning(slice(s - 2, s))] if rng.random() < 0.3 else []
        return [*begun, RandomWalk(0.01 * random_positive(rng, s, s)), measured, moved]

    def corrections(self) -> list[Operation[Any]]:
        rng, n = self.rng, self.landmarks
        if not n:
            return []
        seen = rng.permutation(n)[: rng.integers(1, n + 1)]
        r = int(rng.integers(2, 5))
        correction = Correction(
            residual=rng.standard_normal((len(seen), r)),
            noise=random_positive(rng, r, r),
            H_vehicle=rng.standard_normal((len(seen), r, self.s)),
            H_landmark=rng.standard_normal((len(seen), r, 3)),
            slots=seen,
        )
        # Their own numbers, of all landmarks in their order or of some in any.
        seen = np.arange(n) if rng.random() < 0.7 else seen
        components = np.sort(rng.permutation(3)[: rng.integers(2, 4)])
        residual = rng.standard_normal((len(seen), len(components)))
        noise = rng.uniform(0.3, 2.0, residual.shape)
        return [correction, DirectCorrection(residual, noise, seen, components)]

    def leave(self) -> list[Operation[Any]]:
        rng, n = self.rng, self.landmarks
        if not n:
            return []
        gone = rng.random(n) < 0.3
        gone[rng.integers(n)] = True
        m = int(gone.sum())
        some = rng.random() < 0.7
        positions = WorldPositions(
            rng.standard_normal((m, 3)),
            rng.standard_normal((m, 3, self.s)) if some else None,
            rng.standard_normal((m, 3, 3)) if some else None,
        )
        keys = np.arange(self.next_key, self.next_key + m)
        self.landmarks, self.next_key = n - m, self.next_key + m
        return [Marginalization(keys, gone, partial(WorldPositions, *positions))]

    def join(self) -> list[Operation[Any]]:
        m = int(self.rng.integers(1, 4))
        J = self.rng.standard_normal((m, 3, self.s)) if self.rng.random() < 0.7 else None
        self.landmarks += m
        return [Initialization(random_positive(self.rng, m, 3, 3), J)]


@pytest.mark.parametrize("s", [6, 15])
@pytest.mark.parametrize("seed", range(5))
def test_any_operations_give_what_a_filter_that_keeps_all_gives(s: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    P, tape, course = random_positive(rng, s, s), Tape(), RandomCourse(rng, s)
    state, reference = ErrorState(P, s, tape), KeepingFilter(P)
    for _ in range(12):
        for operation in course.step():
            state.apply(operation)
            reference.apply(operation)
        T_world_body = se3.exp(rng.standard_normal(6))
        state.end_step(T_world_body)
        reference.apply(PoseMark(T_world_body))
    np.testing.assert_allclose(
        state.covariance, reference.P[: reference.size, : reference.size], rtol=1e-9, atol=1e-9
    )
    exact, smoothed = reference.smoothed(), smooth(tape)
    np.testing.assert_array_equal(smoothed.keys, exact.keys)
    for name in ("poses", "pose_covariances", "positions", "covariances"):
        np.testing.assert_allclose(
            getattr(smoothed, name), getattr(exact, name), rtol=1e-9, atol=1e-9, err_msg=name
        )
