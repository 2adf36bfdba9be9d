# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sensor's exposure, vignetting and noise."""

import numpy as np
import pytest

from vislam_ros.data.simulation.images.sensor import Sensor, exposures

SIZE = (64, 48)


def image(radiance, exposure, noise=0.0, seed=0):
    grey = np.full(SIZE[::-1], radiance, dtype=np.uint8)
    return Sensor(SIZE, noise).image(grey, exposure, np.random.default_rng(seed))


def test_exposure_multiplies_and_what_is_too_bright_is_white():
    assert image(100, 1.0)[24, 32] == 100
    assert image(100, 1.5)[24, 32] == 150
    assert image(100, 3.0)[24, 32] == 255


def test_corners_are_darker_than_the_middle():
    lit = image(200, 1.0)
    assert lit[0, 0] == pytest.approx(160, abs=1)
    assert lit[0, 32] > lit[0, 0]


def test_bright_light_is_noisier():
    middle = np.s_[12:36, 16:48]
    dark, bright = (image(grey, 1.0, 1.0)[middle].astype(float) for grey in (10, 200))
    clean = image(200, 1.0)[middle]
    # sqrt(200 * 255 / 10000 + 0.6^2), and what rounding adds.
    assert (bright - clean).std() == pytest.approx(2.36, rel=0.1)
    assert dark.std() < 0.5 * bright.std()


def test_noise_is_that_of_its_seed():
    assert np.array_equal(image(90, 1.0, 1.0, 1), image(90, 1.0, 1.0, 1))
    assert not np.array_equal(image(90, 1.0, 1.0, 1), image(90, 1.0, 1.0, 2))


def test_the_exposure_errs_on_both_sides_and_wanders_between():
    exposure = exposures(np.arange(0, 20, 0.05), np.random.default_rng(0))
    assert 1.8 < exposure.max() < 4
    assert 0.25 < exposure.min() < 0.55
    usual = np.median(exposure)
    near = np.abs(exposure / usual - 1) < 0.4
    assert 0.8 < near.mean() < 0.95
    assert np.all(exposures(np.zeros(1), np.random.default_rng(0)) > 0)
