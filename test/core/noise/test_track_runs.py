# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import chi2

from vislam_ros.core.noise.track_runs import TrackRuns

Array = NDArray[np.float64]

ALL, TWO = np.array([0, 1, 2]), np.array([0, 2])
GATE = 16.27


def distances(runs: TrackRuns, innovations: Array) -> Array:
    """Distances (frames, n) of tracks whose innovations (frames, n, 3) are these."""
    indices = np.arange(innovations.shape[1])
    return np.array([runs.update(indices, ALL, white) for white in innovations])


def test_the_sum_of_a_tracks_frames_is_as_far_off_as_that_of_its_innovations_by_their_number():
    white = np.random.default_rng(91).standard_normal((7, 4, 3))
    runs = TrackRuns()
    runs.add(4)
    expected = [
        np.sum(np.sum(white[: k + 1], axis=0) ** 2, axis=1) / (k + 1) for k in range(len(white))
    ]
    assert_allclose(distances(runs, white), expected)


@pytest.mark.parametrize("components", [ALL, TWO])
def test_white_innovations_are_rejected_at_any_frame_as_often_as_one_gate_says(
    components: NDArray[np.int64],
) -> None:
    rng = np.random.default_rng(92)
    tracks, numbers = 100_000, len(components)
    runs = TrackRuns()
    runs.add(tracks)
    gate = chi2.isf(0.001, numbers)
    for _ in range(10):
        white = rng.standard_normal((tracks, numbers))
        distance = runs.update(np.arange(tracks), components, white)
        assert 0.0007 < np.mean(distance > gate) < 0.0013
        assert_allclose(np.mean(distance), numbers, rtol=0.02)


@pytest.mark.parametrize(("slide", "frames"), [(2.0, 8), (3.0, 4)])
def test_a_track_that_slides_is_caught_within_a_few_frames_and_no_gate_of_a_frame_sees_it(
    slide: float, frames: int
) -> None:
    rng = np.random.default_rng(93)
    white = rng.standard_normal((frames, 1000, 3))
    white[:, :, 0] += slide
    runs = TrackRuns()
    runs.add(1000)
    caught = distances(runs, white) > GATE
    assert np.mean(caught[-1]) > 0.9
    alone = np.sum(white**2, axis=2) > GATE
    assert np.mean(caught[-1]) > 2 * np.mean(alone[-1])


def test_errors_that_change_their_side_are_no_slide() -> None:
    white = np.tile([[[3.0, 0.0, 0.0]], [[-3.0, 0.0, 0.0]]], (10, 1, 1))
    runs = TrackRuns()
    runs.add(1)
    assert np.max(distances(runs, white)) < GATE


def test_sums_go_with_their_landmarks_and_those_that_are_not_seen_keep_theirs() -> None:
    runs = TrackRuns()
    runs.add(3)
    first = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]])
    # In another order than that of the landmarks.
    runs.update(np.array([2, 0, 1]), ALL, first)
    runs.remove(np.array([False, True, False]))
    runs.add(1)
    # Now they are those that were 0 and 2, and a new one.
    assert_allclose(runs.update(np.array([2, 1]), ALL, np.zeros((2, 3))), [0.0, 0.5])
    assert_allclose(runs.update(np.array([0, 1, 2]), ALL, np.zeros((3, 3))), [2.0, 1 / 3, 0.0])


def test_numbers_that_are_not_observed_count_for_nothing() -> None:
    runs = TrackRuns()
    runs.add(1)
    runs.update(np.array([0]), ALL, np.array([[1.0, 10.0, 2.0]]))
    # The second is left out from here on: it repeats what is known.
    assert_allclose(runs.update(np.array([0]), TWO, np.ones((1, 2))), (2**2 + 3**2) / 2)
    assert runs.update(np.array([], dtype=int), ALL, np.empty((0, 3))).shape == (0,)
