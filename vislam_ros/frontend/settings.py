# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the stereo tracker."""

from dataclasses import dataclass

from vislam_ros.core.settings import setting


@dataclass(frozen=True)
class TrackerSettings:
    """How many points are followed, and what is taken for a mistake."""

    max_features: int = setting(
        150,
        "Points that are followed at a time; fewer where the image has no more",
        minimum=1,
        maximum=5000,
        live=True,
    )
    largest_disparity: int = setting(
        0,
        "Disparity of the nearest points that are begun; 0 is a quarter of the image's width [px]",
        minimum=0,
        maximum=10_000,
        live=True,
    )
    smallest_correlation: float = setting(
        0.8,
        "Correlation of grey values, from -1 to 1, under which two views of a point are not "
        "believed to be of the same; at 0.8 the contrast is twice the noise",
        minimum=0.0,
        maximum=1.0,
        live=True,
    )
    row_difference: float = setting(
        1.0,
        "A point whose rows in the two rectified images differ by more is left out [px]",
        minimum=0.0,
        maximum=100.0,
        live=True,
    )
    round_trip: float = setting(
        1.0,
        "A point that does not come back to where it was by so much, when it is followed back in "
        "time or to the left image, is left out [px]",
        minimum=0.0,
        maximum=100.0,
        live=True,
    )
    off_the_motion: float = setting(
        1.5,
        "A point that is farther from where the camera's motion takes it is left out: it moves "
        "by itself, or is taken for another [px]",
        minimum=0.0,
        maximum=10_000.0,
        live=True,
    )
