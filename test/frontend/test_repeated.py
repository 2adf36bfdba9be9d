# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Sequence

import numpy as np
import pytest
from frontend.rendered_world import Shot

from vislam_ros.frontend.repeated import is_repeated


def test_a_copy_is_repeated_also_with_a_time_written_over_it(walk: Sequence[Shot]) -> None:
    image = walk[0].left
    stamped = image.copy()
    stamped[:20, :150] = 255 - stamped[:20, :150]
    assert is_repeated(image.copy(), image)
    assert is_repeated(stamped, image)


def test_a_standing_cameras_images_are_not(stand: Sequence[Shot]) -> None:
    assert not is_repeated(stand[1].left, stand[0].left)


def test_a_moving_cameras_images_are_not(walk: Sequence[Shot]) -> None:
    assert not is_repeated(walk[1].left, walk[0].left)


@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_say_nothing(level: int) -> None:
    image = np.full((60, 80), level, np.uint8)
    assert not is_repeated(image, image)


@pytest.mark.parametrize(("share", "is_copy"), [(0.08, True), (0.12, False)])
def test_a_tenth_may_differ(share: float, is_copy: bool) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(50, 200, (300, 400), dtype=np.uint8)
    other = np.where(rng.random(image.shape) < share, image + 1, image).astype(np.uint8)
    assert is_repeated(other, image) == is_copy
