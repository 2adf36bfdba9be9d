# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from vislam_ros.frontend.picture import Trails, captioned, drawn_tracks
from vislam_ros.frontend.tracker import Tracked

IMAGE = np.full((100, 200), 40, np.uint8)


def frame(places: dict[int, tuple[float, float, float]], *, repeated: bool = False) -> Tracked:
    """Points by id: u, v and disparity."""
    pixels = np.array([[u, v, u - d, v] for u, v, d in places.values()], np.float32)
    ids = np.array(list(places), np.uint32)
    return Tracked(ids, pixels.reshape(-1, 4), np.full(len(ids), 0.1, np.float32), repeated)


def test_a_near_point_is_red_and_a_far_one_blue() -> None:
    trails = Trails()
    for shift in (0, 1):
        shown = frame({1: (50 + shift, 50, 60), 2: (150 + shift, 50, -0.1)})
        trails.add(shown)
    picture = drawn_tracks(IMAGE, shown, trails).astype(int)
    assert picture.shape == (100, 200, 3)
    near, far = picture[50, 51], picture[50, 151]
    assert near[2] > near[0] + 50
    assert far[0] > far[2] + 20
    assert_array_equal(picture[5, 5], [40, 40, 40])


def test_a_trail_leads_to_where_the_point_was() -> None:
    trails = Trails()
    for u in (30, 60, 90):
        shown = frame({1: (u, 50, 10), 2: (u, 80, 10)} if u < 90 else {1: (u, 50, 10)})
        trails.add(shown)
    assert_allclose(trails.of(shown.ids)[0], [[90, 50], [60, 50], [30, 50]])
    picture = drawn_tracks(IMAGE, shown, trails)
    assert picture[50, 45].tolist() != [40, 40, 40]
    # The one that is gone is not drawn.
    assert np.all(picture[75:] == 40)


def test_a_trail_ends_where_the_point_was_not_seen() -> None:
    trails = Trails()
    for places in ({1: (10.0, 5.0, 1.0)}, {2: (1.0, 5.0, 1.0)}, {1: (30.0, 5.0, 1.0)}):
        trails.add(frame(places))
    assert_allclose(trails.of(np.array([1], np.uint32))[0], [[30, 5]])


def test_a_new_point_is_a_ring() -> None:
    shown = frame({1: (50, 50, 10)})
    trails = Trails()
    trails.add(shown)
    for picture in (drawn_tracks(IMAGE, shown), drawn_tracks(IMAGE, shown, trails)):
        assert np.all(picture[50, 50] == 40)
        assert np.any(picture[50, 53] != 40)


def test_a_repeated_or_empty_frame_is_the_image() -> None:
    nothing = frame({}, repeated=True)
    trails = Trails()
    trails.add(frame({1: (50, 50, 10)}))
    trails.add(nothing)
    assert np.all(drawn_tracks(IMAGE, nothing, trails) == 40)
    assert len(trails.of(np.array([1], np.uint32))[0]) == 1


def test_a_caption_below_says_what_the_marks_mean() -> None:
    for width in (200, 480, 1241):
        picture = np.full((100, width, 3), 40, np.uint8)
        whole = captioned(picture)
        assert_array_equal(whole[:100], picture)
        line = whole[100:].astype(int)
        assert line.shape[1] == width
        # Words and marks, and room to the right of them.
        assert np.any(line < 200)
        assert np.all(line[:, -3:] == 255)
        red, blue = (np.any(line[..., c] > line[..., 2 - c] + 50) for c in (2, 0))
        assert red
        assert blue
