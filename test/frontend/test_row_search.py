# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from vislam_ros.frontend.row_search import row_search

Grey = NDArray[np.uint8]
POINT = np.array([[120.0, 30.0]], np.float32)


def texture(seed: int = 0) -> Grey:
    return np.random.default_rng(seed).integers(20, 230, (60, 240), dtype=np.uint8)


@pytest.mark.parametrize("disparity", [-2, -1, 0, 1, 17, 60])
def test_a_disparity_is_found(disparity: int) -> None:
    left = texture()
    right = np.roll(left, -disparity, axis=1)
    found, correlation = row_search(left, right, POINT, 60)
    assert_array_equal(found, [disparity])
    assert correlation[0] > 0.999


@pytest.mark.parametrize("disparity", [-3, 61])
def test_a_disparity_outside_of_the_search_is_not(disparity: int) -> None:
    left = texture()
    found, _ = row_search(left, np.roll(left, -disparity, axis=1), POINT, 60)
    assert np.isnan(found[0])


def test_another_exposure_does_not_matter() -> None:
    left = texture()
    right = (np.roll(left, -9, axis=1) * 0.5 + 30).astype(np.uint8)
    assert_array_equal(row_search(left, right, POINT, 60)[0], [9])


def test_what_repeats_itself_along_the_row_is_left_out() -> None:
    left = np.tile(texture()[:, :16], (1, 15))
    assert np.isnan(row_search(left, np.roll(left, -5, axis=1), POINT, 60)[0][0])
    # The same period, with a place that is its own.
    left = left.copy()
    left[24:37, 114:127] = texture(1)[24:37, 114:127]
    assert_array_equal(row_search(left, np.roll(left, -5, axis=1), POINT, 60)[0], [5])


def test_a_match_must_find_its_way_back() -> None:
    left, right = texture(2), texture(3)
    # The right image has the pattern once; the left one twice, and the nearer one is not exact.
    pattern = texture(4)[24:37, :13]
    left[24:37, 114:127] = np.clip(pattern.astype(int) + texture(5)[24:37, :13] // 8, 0, 255)
    right[24:37, 94:107] = pattern
    assert_array_equal(row_search(left, right, POINT, 60)[0], [20])
    left[24:37, 134:147] = pattern
    assert np.isnan(row_search(left, right, POINT, 60)[0][0])


@pytest.mark.parametrize("place", [(4, 30), (120, 4), (236, 30), (120, 56), (-50, 30), (1e4, 30)])
def test_the_rim_has_no_match(place: tuple[float, float]) -> None:
    image = texture()
    assert np.isnan(row_search(image, image, np.array([place], np.float32), 60)[0][0])


def test_a_flat_image_has_no_match() -> None:
    flat = np.full((60, 240), 100, np.uint8)
    assert np.isnan(row_search(flat, flat, POINT, 60)[0][0])


def test_the_correlation_is_that_of_opencv() -> None:
    left = np.asarray(cv2.GaussianBlur(texture(6), (5, 5), 0), np.uint8)
    noisy = np.clip(np.roll(left, -7, 1) * 0.7 + texture(7) / 4, 0, 255).astype(np.uint8)
    right = np.asarray(cv2.GaussianBlur(noisy, (3, 3), 0), np.uint8)
    (disparity,), (correlation,) = row_search(left, right, POINT, 60)
    strip = right[25:36, 120 - 60 - 5 : 122 + 6]
    scores = cv2.matchTemplate(strip, left[25:36, 115:126], cv2.TM_CCOEFF_NORMED)[0]
    assert disparity == 60 - np.argmax(scores)
    assert correlation == pytest.approx(scores.max(), abs=1e-5)
