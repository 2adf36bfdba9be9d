# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from vislam_ros.frontend.patches import HALF, REACH, cut_patches, fits, joined, place

Floats = NDArray[np.float32]
Grey = NDArray[np.uint8]
SAME = np.eye(2)[None]


class Scene:
    """Waves of all directions, so that grey values are known between the pixels, too."""

    def __init__(self, seed: int = 0):
        rng = np.random.default_rng(seed)
        angles = rng.uniform(0, 2 * np.pi, 30)
        # Wavelengths of eight pixels and more.
        self._waves = rng.uniform(0.1, 0.8, 30)[:, None] * np.stack(
            [np.cos(angles), np.sin(angles)], 1
        )
        self._phases = rng.uniform(0, 2 * np.pi, 30)

    def seen(self, A: NDArray[np.float64], centre: Floats, shift: Floats) -> NDArray[np.float64]:
        """Image in which what is about ``centre`` lies about ``centre + shift``, by A."""
        x, y = np.meshgrid(np.arange(160.0), np.arange(160.0))
        places = (np.stack([x, y], -1) - centre - shift) @ A.T + centre
        return 128 + 10 * np.sin(places @ self._waves.T + self._phases).sum(-1)


CENTRE, STILL = np.array([80.0, 80.0], np.float32), np.zeros(2, np.float32)


def rounded(image: NDArray[np.float64]) -> Grey:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def plain(seed: int) -> Grey:
    return rounded(Scene(seed).seen(np.eye(2), CENTRE, STILL))


def test_a_shift_is_found_to_hundredths_of_a_pixel() -> None:
    centre, shift = np.array([80.3, 77.6], np.float32), np.array([1.37, -0.81], np.float32)
    other = rounded(Scene().seen(np.eye(2), centre, shift))
    found = place(cut_patches(plain(0), centre[None]), SAME, other, centre[None])
    assert_allclose(found.points[0], centre + shift, atol=0.02)
    assert found.correlation[0] > 0.99


@pytest.mark.parametrize(("gain", "offset"), [(0.5, 60.0), (1.4, -40.0)])
def test_brightness_and_contrast_do_not_matter(gain: float, offset: float) -> None:
    shift = np.array([0.6, 0.4], np.float32)
    image, other = (0.5 * Scene(1).seen(np.eye(2), CENTRE, move) + 60 for move in (STILL, shift))
    patches = cut_patches(rounded(image), CENTRE[None])
    found = place(patches, SAME, rounded(gain * other + offset), CENTRE[None])
    assert_allclose(found.points[0], CENTRE + shift, atol=0.02)


def test_a_map_lays_a_patch_over_a_view_that_is_nearer_and_turned() -> None:
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    A, shift = 0.7 * turn, np.array([1.0, 0.5], np.float32)
    other = rounded(Scene(2).seen(A, CENTRE, shift))
    patches = cut_patches(plain(2), CENTRE[None])
    with_map = place(patches, A[None], other, CENTRE[None])
    # Grey values between the pixels are less sharp than those of the nearer view.
    assert_allclose(with_map.points[0], CENTRE + shift, atol=0.04)
    assert place(patches, SAME, other, CENTRE[None]).correlation[0] < 0.9


def test_the_slope_of_a_disparity_is_found_with_it() -> None:
    slopes, shift = np.array([-0.12, 0.15]), np.array([0.7, 0.0], np.float32)
    # From a step in the left image to that in the right one, so the view is by its inverse.
    to_right = np.array([[1 + slopes[0], slopes[1]], [0, 1]])
    other = rounded(Scene(3).seen(np.linalg.inv(to_right), CENTRE, shift))
    none = np.zeros((1, 2), np.float32)
    found = place(cut_patches(plain(3), CENTRE[None]), SAME, other, CENTRE[None], none)
    assert_allclose(found.slopes[0], slopes, atol=0.02)
    assert_allclose(found.points[0], CENTRE + shift, atol=0.02)


def test_the_covariance_is_that_of_noisy_images() -> None:
    image, rng = Scene(4).seen(np.eye(2), CENTRE, STILL), np.random.default_rng(4)
    centres = rng.uniform(40, 120, (12, 2)).astype(np.float32)
    maps = np.tile(np.eye(2), (12, 1, 1))
    ratios = []
    for noise in (3.0, 9.0):
        errors, stated = [], []
        for _ in range(60):
            one, two = (rounded(image + rng.normal(0, noise, image.shape)) for _ in range(2))
            found = place(cut_patches(one, centres), maps, two, centres)
            errors.append(found.points - centres)
            stated.append(found.covariance)
        true, claimed = np.var(errors, axis=0), np.mean(stated, axis=0)
        ratios.append(np.sqrt(np.median(true / claimed[:, [0, 2]])))
        both = np.mean(np.prod(errors, axis=2), axis=0)
        assert np.corrcoef(both, claimed[:, 1])[0, 1] > 0.7
    # Interpolated pixels share their noise with their neighbours, which the fit does not know.
    assert 1.0 < ratios[0] < 1.8
    assert abs(ratios[1] / ratios[0] - 1) < 0.2


@pytest.mark.parametrize(
    ("grey", "guess"),
    [
        (np.full((160, 160), 90, np.uint8), (80.0, 80.0)),
        (np.tile(np.arange(160, dtype=np.uint8), (160, 1)), (80.0, 80.0)),
        (plain(5), (HALF - 1.0, 80.0)),
        (plain(5), (80.0, 200.0)),
        (plain(5), (np.nan, 80.0)),
        (plain(5), (1e30, 80.0)),
    ],
    ids=["flat", "an edge", "the rim", "outside", "no number", "far outside"],
)
def test_where_nothing_can_be_compared_there_is_no_correlation(
    grey: Grey, guess: tuple[float, float]
) -> None:
    patches = cut_patches(grey, np.array([[80, 80]], np.float32))
    start = np.array([guess], np.float32)
    found = place(patches, SAME, grey, start)
    assert found.correlation[0] == -1
    assert_array_equal(found.points, start)


def test_a_patch_is_cut_at_the_rim_and_joined_to_others() -> None:
    image = plain(6)
    points = np.array([[0.25, 159.0], [80.0, 80.5]], np.float32)
    patches = cut_patches(image, points)
    assert_array_equal(patches.grey[0, REACH, REACH], image[159, 0])
    assert_array_equal(patches.grey[0, : REACH + 1, 0], image[159 - REACH :, 0])
    assert_allclose(patches.fraction, [[0.25, 0.0], [0.0, 0.5]])
    both = joined(patches[np.array([1])], patches[np.array([0])])
    assert_array_equal(both.grey, patches.grey[::-1])


def test_a_patch_fits_until_it_ends_or_is_too_blurred() -> None:
    scales = np.array([1.0, 0.7, 0.55, 1.4, 1.6])
    maps = scales[:, None, None] * np.eye(2)
    assert_array_equal(fits(maps), [True, True, False, True, False])
