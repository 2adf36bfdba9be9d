# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Of too many new features those are followed that cover the image best."""

import numpy as np
import pytest
from numpy.typing import NDArray

from vislam_ros.core.tracking.spread import best_spread
from vislam_ros.core.tracking.tracks import Tracks

NONE = np.empty((0, 4), dtype=np.float32)


def at(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float32]:
    """Features at left pixels."""
    return np.column_stack([u, v, u - 5.0, v]).astype(np.float32)


def crowded(rng: np.random.Generator) -> NDArray[np.float32]:
    """A thousand features in one corner, and a hundred over the whole image before them."""
    everywhere = at(rng.uniform(0, 1000, 100), rng.uniform(0, 500, 100))
    return np.concatenate([everywhere, at(rng.uniform(0, 50, 1000), rng.uniform(0, 50, 1000))])


def test_a_crowd_does_not_push_out_the_rest() -> None:
    features = crowded(np.random.default_rng(0))
    chosen = best_spread(features, 100, NONE)
    assert len(np.unique(chosen)) == 100
    assert np.all(np.diff(chosen) > 0)
    assert np.count_nonzero(chosen < 100) > 50


def test_where_nothing_is_followed_yet_comes_first() -> None:
    u, v = np.meshgrid(np.linspace(0, 1000, 20), np.linspace(0, 500, 20))
    features = at(u.ravel(), v.ravel())
    left_half = features[features[:, 0] < 500]
    chosen = best_spread(features, 100, left_half)
    assert np.all(features[chosen, 0] >= 450)


def test_the_choice_is_the_same_whatever_comes_far_outside() -> None:
    features = crowded(np.random.default_rng(1))
    outlier = at(np.array([1e6]), np.array([-1e6]))
    chosen = best_spread(np.concatenate([features, outlier]), 100, NONE)
    assert np.count_nonzero(chosen < 100) > 50


@pytest.mark.parametrize("count", [0, 1, 7])
def test_as_many_are_chosen_as_there_is_room_for(count: int) -> None:
    features = at(np.full(50, 3.0), np.full(50, 4.0))
    assert best_spread(features, count, NONE).tolist() == list(range(count))


def follow(tracks: Tracks, ids: range, rng: np.random.Generator) -> tuple[int, int]:
    """Give a frame; return how many observations were followed and how many left out."""
    pixels = at(rng.uniform(0, 1000, len(ids)), rng.uniform(0, 500, len(ids)))
    frame = tracks.observe(np.array(ids, dtype=np.uint32), pixels, lambda: True)
    return len(frame.keys), frame.left_out


def test_tracks_that_are_followed_keep_their_place_and_new_ones_take_what_is_left() -> None:
    rng = np.random.default_rng(2)
    tracks = Tracks(1, None, most=100)
    assert follow(tracks, range(80), rng) == (80, 0)
    assert follow(tracks, range(40, 100), rng) == (60, 0)
    assert follow(tracks, range(40, 1000), rng) == (100, 860)
    assert tracks.ids_seen == 140


@pytest.mark.parametrize(("ids", "left_out"), [(range(100), 0), (range(101), 1)])
def test_a_frame_that_just_fits_is_followed_whole(ids: range, left_out: int) -> None:
    assert follow(Tracks(1, None, most=100), ids, np.random.default_rng(3))[1] == left_out


def test_tracks_that_may_come_back_keep_their_place() -> None:
    rng = np.random.default_rng(4)
    tracks = Tracks(3, None, most=100)
    assert follow(tracks, range(90), rng) == (90, 0)
    assert follow(tracks, range(200, 300), rng) == (10, 90)
    assert follow(tracks, range(90), rng) == (90, 0)


def test_without_a_bound_all_are_followed() -> None:
    assert follow(Tracks(1, None), range(3000), np.random.default_rng(5)) == (3000, 0)
