# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A frame that waits is as it came, and is rectified when its camera is known."""

import numpy as np
import pytest

from vislam_ros.core.geometry.pixel_rectification import Intrinsics, rectified_pair
from vislam_ros.core.tracking.pending_frame import PendingFrame

LEFT = Intrinsics(400.0, 400.0, 320.0, 240.0)
ASIDE = np.array([[1.0, 0, 0, 0.1], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])


def frame(count):
    pixels = np.random.default_rng(0).uniform(0, 480, (count, 4)).astype(np.float32)
    noise = np.full(count, 0.1, dtype=np.float32)
    return PendingFrame(0, 1, np.arange(count, dtype=np.uint32), pixels, noise)


@pytest.mark.parametrize(("count", "weight"), [(0, 1), (999, 1), (1000, 2), (2500, 3)])
def test_large_frames_count_as_several(count, weight):
    assert frame(count).weight == weight


def test_without_a_rectification_nothing_changes():
    waiting = frame(5)
    assert waiting.rectified(None) is waiting


def test_pixels_become_those_of_the_rectified_pair():
    waiting = frame(5)
    rectification = rectified_pair(LEFT, LEFT._replace(cx=310.0), ASIDE).pixels
    rectified = waiting.rectified(rectification)
    np.testing.assert_array_equal(rectified.ids, waiting.ids)
    np.testing.assert_array_equal(rectified.noise, waiting.noise)
    moved = rectified.pixels - waiting.pixels
    np.testing.assert_allclose(moved, [[0, 0, 10, 0]] * 5, atol=1e-4)
