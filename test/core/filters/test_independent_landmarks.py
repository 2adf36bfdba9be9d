# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numerics import CAMERA
from scenes import STANDING, frame_of

from vislam_ros.core.filters.mapping import MappingFilter, MappingSettings


def test_the_least_disparity_that_is_used_is_the_one_that_is_set() -> None:
    filter_ = MappingFilter(MappingSettings(min_disparity=6.0), CAMERA)
    pixels = np.array([[600.0, 180.0, 594.0, 180.0], [600.0, 180.0, 594.5, 180.0]])
    assert filter_.step(STANDING, frame_of([4, 5], pixels)).admitted == 1
    assert filter_.landmarks()[0].tolist() == [4]
    assert filter_.step(STANDING, frame_of([4, 5], pixels)).used == 1


def test_a_landmark_that_was_rejected_stays_in_the_map_and_is_active_no_more() -> None:
    filter_ = MappingFilter(MappingSettings(), CAMERA)
    pixels = np.array([[600.0, 180.0, 580.0, 180.0], [300.0, 180.0, 280.0, 180.0]])
    filter_.step(STANDING, frame_of([1, 2], pixels))
    pixels[1] += 500.0
    outcome = filter_.step(STANDING, frame_of([1, 2], pixels))
    assert (outcome.used, outcome.rejected.tolist()) == (1, [2])
    assert (filter_.active, filter_.landmark_count) == (1, 2)
