# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An estimate is laid onto its reference as well as may be, and it is told when not in one way."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from vislam_ros.core.geometry import se3
from vislam_ros.data.evaluation.alignment import (
    ALIGNMENTS,
    AlignmentKind,
    align_positions,
    alignment,
    best_scale,
    yaw_alignment,
)
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]


def curve(poses: int = 80) -> Array:
    """A turn of 10 m radius that climbs."""
    angle = np.linspace(0, 2, poses)
    return np.stack([10 * np.cos(angle), 10 * np.sin(angle), angle], axis=1)


def moved(points: Array, T: Array) -> Array:
    return points @ T[:3, :3].T + T[:3, 3]


@pytest.mark.parametrize("yaw", [-3.0, -0.4, 0.0, 1.6, 3.1])
def test_a_turn_about_the_vertical_is_undone(yaw: float) -> None:
    T = se3.exp([0, 0, 0, 0, 0, yaw])
    T[:3, 3] = [100.0, -20.0, 3.0]
    np.testing.assert_allclose(yaw_alignment(curve(), moved(curve(), T)), T, atol=1e-12)


def test_no_turn_about_the_vertical_fits_better() -> None:
    rng = np.random.default_rng(0)
    source = curve() + rng.normal(size=(80, 3))
    target = moved(curve(), se3.exp([1, 2, 3, 0.1, -0.2, 1.0]))

    def cost(yaw: float) -> float:
        turned = source @ se3.exp_rotation([0, 0, yaw]).T
        return float(np.sum((turned - turned.mean(axis=0) - target + target.mean(axis=0)) ** 2))

    best = minimize_scalar(cost, bounds=(-np.pi, np.pi), method="bounded", options={"xatol": 1e-9})
    T = yaw_alignment(source, target)
    assert np.sum((moved(source, T) - target) ** 2) == pytest.approx(best.fun, rel=1e-9)
    assert T[2, :3].tolist() == [0.0, 0.0, 1.0]


def test_the_scale_of_a_path_that_was_stretched_and_moved_is_found() -> None:
    target = moved(1.02 * curve(), se3.exp([1, 2, 3, 0.1, -0.2, 1.0]))
    assert best_scale(curve(), target) == pytest.approx(1.02, abs=1e-12)


def test_no_scale_of_the_aligned_path_fits_better() -> None:
    rng = np.random.default_rng(0)
    source = curve() + rng.normal(size=(80, 3))
    target = moved(curve(), se3.exp([1, 2, 3, 0.1, -0.2, 1.0]))

    def cost(scale: float) -> float:
        return float(np.sum(align_positions(scale * source, target).residual ** 2))

    best = minimize_scalar(cost, bounds=(0.5, 1.5), method="bounded", options={"xatol": 1e-9})
    assert best_scale(source, target) == pytest.approx(best.x, abs=1e-6)


def test_a_body_that_never_moves_has_no_scale() -> None:
    assert best_scale(np.ones((5, 3)), curve(5)) is None


def test_each_freedom_fits_at_least_as_well_as_the_lesser_one() -> None:
    target = moved(curve(), se3.exp([1, 2, 3, 0.1, -0.2, 1.0]))
    assert ALIGNMENTS == ("se3", "yaw", "none")
    errors = [
        float(np.linalg.norm(align_positions(curve(), target, kind).residual))
        for kind in ALIGNMENTS
    ]
    assert errors[0] < 1e-10 < errors[1] < errors[2]
    np.testing.assert_array_equal(
        align_positions(curve(), target, "none").T_reference_estimate, np.eye(4)
    )
    np.testing.assert_array_equal(
        align_positions(curve(), target, "se3").T_reference_estimate, alignment(curve(), target)
    )


def test_an_alignment_of_another_name_is_refused() -> None:
    with pytest.raises(VislamError, match="align is 'sim3': choose one of se3, yaw, none"):
        align_positions(curve(), curve(), "sim3")  # type: ignore[arg-type]


def wavy_line(amplitude: float, noise: float) -> tuple[Array, Array]:
    """Estimate and truth of a road that leaves a straight line by this much, root mean square."""
    x = np.linspace(0.0, 200.0, 400)
    aside = np.sqrt(2) * amplitude * np.sin(x / 200 * 10 * np.pi)
    target = np.stack([x, aside, np.zeros(400)], axis=1)
    rng = np.random.default_rng(1)
    return target + noise / np.sqrt(3) * rng.normal(size=target.shape), target


@pytest.mark.parametrize(("amplitude", "is_unique"), [(0.0, False), (0.1, False), (0.4, True)])
def test_a_line_is_one_to_within_the_errors(amplitude: float, is_unique: bool) -> None:
    source, target = wavy_line(amplitude, noise=0.2)
    ambiguity = align_positions(source, target, "se3").ambiguity
    assert (ambiguity is None) == is_unique
    if ambiguity:
        assert "straight line" in ambiguity
    assert align_positions(source, target, "yaw").ambiguity is None
    assert align_positions(source, target, "none").ambiguity is None


@pytest.mark.parametrize("kind", ["se3", "yaw"])
@pytest.mark.parametrize(("way", "is_unique"), [(0.0, False), (0.1, False), (6.0, True)])
def test_standing_fixes_no_angle(kind: AlignmentKind, way: float, is_unique: bool) -> None:
    target = way / 10 * curve() + [4e5, 5e6, 100.0]
    source = target + 0.5 / np.sqrt(3) * np.random.default_rng(2).normal(size=target.shape)
    ambiguity = align_positions(source, target, kind).ambiguity
    assert (ambiguity is None) == is_unique
    if ambiguity:
        assert "any turn fits as well" in ambiguity


def test_climbing_straight_up_fixes_no_yaw() -> None:
    target = np.linspace(0, 50, 100)[:, None] * [0.0, 0.0, 1.0]
    assert align_positions(target, target, "yaw").ambiguity is not None
    assert align_positions(target, target, "se3").ambiguity is not None


def test_an_exact_line_far_from_the_origin_is_one() -> None:
    target = np.linspace(0, 50, 100)[:, None] * [1.0, 0.3, 0.01] + [4e5, 5e6, 100.0]
    assert "straight line" in str(align_positions(target, target, "se3").ambiguity)
