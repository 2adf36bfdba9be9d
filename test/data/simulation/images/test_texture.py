# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Textures repeat, get blunter without moving, and noise has all scales."""

import numpy as np
import pytest

from vislam_ros.data.simulation.images.texture import Texture, bricks, fractal, letters


def test_a_level_is_the_mean_of_its_texels():
    picture = np.random.default_rng(0).uniform(0, 255, (64, 128))
    texture = Texture(picture, 10.0)
    level = texture.level((2, 1))
    assert level.shape == (32, 32)
    means = texture.level((0, 0)).reshape(32, 2, 32, 4).mean(axis=(1, 3))
    assert np.abs(level - means).max() <= 1.6  # it is rounded at each halving


@pytest.mark.parametrize(
    ("footprint", "level"),
    [((0.3, 0.9), (0, 0)), ((1.9, 2.0), (0, 1)), ((8.1, 1.0), (3, 0)), ((1e9, 1e9), (7, 6))],
)
def test_a_level_has_texels_no_larger_than_a_pixel_as_far_as_there_are_levels(footprint, level):
    assert Texture(np.zeros((64, 128)), 1.0).nearest_level(*footprint) == level


def test_noise_repeats_without_a_seam():
    noise = fractal((256, 512), 64, np.random.default_rng(1), persistence=0.5)
    assert noise.shape == (256, 512)
    inner = np.abs(np.diff(noise, axis=1)).mean()
    assert np.abs(noise[:, 0] - noise[:, -1]).mean() == pytest.approx(inner, rel=0.3)
    inner = np.abs(np.diff(noise, axis=0)).mean()
    assert np.abs(noise[0] - noise[-1]).mean() == pytest.approx(inner, rel=0.3)


def test_noise_has_features_of_all_scales():
    noise = fractal((512, 512), 128, np.random.default_rng(2))
    assert noise.std() == pytest.approx(0.85, abs=0.25)
    for factor in (2, 8, 32):
        coarse = noise.reshape(512 // factor, factor, 512 // factor, factor).mean(axis=(1, 3))
        assert np.diff(coarse, axis=0).std() > 0.1


def test_bricks_have_joints_and_greys_of_their_own():
    picture = bricks((64, 128), (16, 32), np.random.default_rng(0), grey=100, spread=20)
    assert picture[16, 5:30].mean() == pytest.approx(130, abs=5)
    inside = [picture[2:15, x : x + 28].mean() for x in (2, 34, 66, 98)]
    assert np.std(inside) > 5


def test_letters_leave_what_is_around_them():
    canvas = np.full((64, 64), 100.0, dtype=np.float32)
    letters(canvas, "AB", (10, 40), 20, 10.0)
    assert canvas.min() < 20
    assert np.all(canvas[:, :5] == 100)
    assert canvas.max() == 100
