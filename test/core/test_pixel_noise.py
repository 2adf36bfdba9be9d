# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from vislam_ros.core.pixel_noise import PixelNoise

Array = NDArray[np.float64]


def learned(
    tracks: int, white: float, constant: float, *, wild: float = 0.0, length: int = 10
) -> PixelNoise:
    """Let the noise judge tracks of known points, whose errors are white and constant ones.

    The filter that gives the scores knows where each track's next pixel should be but for R.
    """
    rng = np.random.default_rng(51)
    noise = PixelNoise()
    count = 50
    for _ in range(tracks // count):
        noise.begin(count)
        offset = constant * rng.standard_normal((count, 3))
        offset[rng.random(count) < wild] += 100.0
        for _ in range(length):
            residual = offset + white * rng.standard_normal((count, 3))
            S_inverse = np.eye(3 * count) / noise.level
            noise.see(np.arange(count), S_inverse, S_inverse @ residual.ravel())
        noise.end(np.ones(count, dtype=bool))
    return noise


@pytest.mark.parametrize("white", [0.1, 0.5, 1.0, 3.0])
def test_the_level_of_white_noise_is_found_from_afar(white: float) -> None:
    assert_allclose(np.sqrt(learned(20000, white, 0.0).level), white, rtol=0.1)


def test_an_error_that_a_track_keeps_counts_for_what_it_does_to_it() -> None:
    # Ten repetitions of an error of a tenth of the variance are as bad as white noise of the
    # whole; their innovations' variance would be a fifth of that.
    level = learned(20000, np.sqrt(0.1), np.sqrt(0.1)).level
    assert_allclose(level, 0.1 + 10 * 0.1, rtol=0.15)


def test_outliers_hardly_raise_the_level() -> None:
    assert_allclose(learned(10000, 1.0, 0.0, wild=0.05).level, 1.0, rtol=0.2)


def test_scores_follow_their_landmarks_when_others_end() -> None:
    def judged(first: list[int], order: list[int]) -> float:
        noise = PixelNoise()
        noise.begin(3)
        weighted = np.repeat([0.1, 5.0, 0.2], 3)
        places = np.arange(9).reshape(3, 3)[order].ravel()
        noise.see(np.array(order), np.eye(9), weighted[places])
        noise.end(np.isin(np.arange(3), first))
        noise.begin(1)
        noise.end(np.isin(np.arange(4 - len(first)), [1]))
        return noise.level

    assert judged([0], [2, 0, 1]) == judged([0], [0, 1, 2])
    # Of the two that go one after the other, one has a small score and one a large one.
    assert_allclose(judged([1], [0, 1, 2]), judged([0], [0, 1, 2]), rtol=0.1)


def test_landmarks_that_were_never_seen_again_teach_nothing() -> None:
    noise = PixelNoise()
    noise.begin(5)
    noise.end(np.array([True, False, True, False, False]))
    assert noise.level == 1.0
    noise.see(np.array([2, 0]), np.eye(6), np.zeros(6))
    noise.end(np.array([False, True, False]))
    assert noise.level == 1.0
    noise.end(np.ones(2, dtype=bool))
    assert noise.level < 1.0


def test_noise_that_is_none_keeps_some_level() -> None:
    level = learned(200000, 0.0, 0.0, length=1).level
    assert_allclose(level, 1e-4, rtol=1e-9)
    assert_array_equal(np.isfinite(level), True)
