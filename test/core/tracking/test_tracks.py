# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from vislam_ros.core.tracking.tracks import Tracks, indices_of, is_member


def frame_of(pixel_of_id):
    ids = np.array(list(pixel_of_id), dtype=np.uint32)
    pixels = np.array([[u, 1.0, u - 10.0, 1.0] for u in pixel_of_id.values()], dtype=np.float32)
    return ids, pixels.reshape(-1, 4)


def observe(tracks, pixel_of_id, motion_expected=True, missed=0):
    """Return the frame and a dict from id to key."""
    ids, pixels = frame_of(pixel_of_id)
    frame = tracks.observe(ids, pixels, lambda: motion_expected, missed)
    return frame, dict(
        zip(tracks.identity(frame.keys)[0].tolist(), frame.keys.tolist(), strict=True)
    )


@pytest.fixture
def tracks():
    return Tracks(retire_after=1, frozen_share=0.5)


def test_a_track_keeps_its_key_while_it_is_seen(tracks):
    _, first = observe(tracks, {7: 100, 3: 200})
    frame, second = observe(tracks, {3: 201, 7: 101, 9: 50})
    assert second[7] == first[7]
    assert second[3] == first[3]
    assert second[9] not in first.values()
    assert not frame.frozen
    assert not len(frame.ended)


def test_arrays_that_cannot_be_written_to_are_taken_as_they_are(tracks):
    frames = []
    for _ in range(2):
        ids, pixels = frame_of({7: 100, 3: 200})
        ids, pixels = (np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape) for a in (ids, pixels))
        frames.append(tracks.observe(ids, pixels, lambda: False))
    np.testing.assert_array_equal(frames[0].keys, frames[1].keys)
    assert frames[0].pixels[:, 0].tolist() == [200, 100]


def test_pixels_come_in_the_order_of_the_keys(tracks):
    observe(tracks, {7: 100, 3: 200})
    frame, keys = observe(tracks, {9: 50, 3: 201, 7: 101})
    by_key = dict(zip(frame.keys.tolist(), frame.pixels[:, 0].tolist(), strict=True))
    assert by_key == {keys[9]: 50, keys[3]: 201, keys[7]: 101}
    assert np.all(np.diff(frame.keys) > 0)


def test_a_frame_that_repeats_most_pixels_while_moving_is_frozen(tracks):
    _, first = observe(tracks, {1: 100, 2: 200, 3: 300})
    frame, second = observe(tracks, {1: 100, 2: 200, 3: 301, 4: 400})
    assert frame.frozen
    assert second[3] == first[3]
    assert second[1] != first[1]
    assert second[2] != first[2]
    assert sorted(frame.ended) == sorted([first[1], first[2]])
    _, generations = tracks.identity(frame.keys)
    assert sorted(generations.tolist()) == [0, 0, 1, 1]


def test_a_standing_car_may_repeat_its_pixels(tracks):
    _, first = observe(tracks, {1: 100, 2: 200})
    frame, second = observe(tracks, {1: 100, 2: 200}, motion_expected=False)
    assert not frame.frozen
    assert second == first


def test_a_few_repeated_pixels_are_chance(tracks):
    observe(tracks, {1: 100, 2: 200, 3: 300})
    assert not observe(tracks, {1: 100, 2: 201, 3: 301})[0].frozen


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_exactly_the_share_of_repeated_tracks_is_not_yet_frozen(share):
    before = {track: 100.0 * track for track in range(1, 9)}
    for more, frozen in ((0, False), (1, True)):
        tracks = Tracks(retire_after=1, frozen_share=share)
        observe(tracks, before)
        moved = int(8 * (1 - share)) - more
        frame, _ = observe(tracks, {t: u + (t <= moved) for t, u in before.items()})
        assert frame.frozen is frozen


def test_the_share_is_of_the_tracks_in_both_frames_alone():
    tracks = Tracks(retire_after=3, frozen_share=0.5)
    observe(tracks, {1: 100, 2: 200, 3: 300, 8: 800, 9: 900})
    observe(tracks, {1: 101, 2: 201, 3: 301})
    # Two of three repeat their pixels; two are back and one is new.
    frame, _ = observe(tracks, {1: 101, 2: 201, 3: 302, 4: 400, 8: 802, 9: 902})
    assert frame.frozen


def test_nothing_repeated_is_not_frozen_even_where_any_share_would_be():
    tracks = Tracks(retire_after=1, frozen_share=0.0)
    assert not observe(tracks, {1: 100})[0].frozen
    assert not observe(tracks, {1: 101})[0].frozen
    assert not observe(tracks, {})[0].frozen


def test_whether_motion_is_expected_is_asked_only_where_many_pixels_repeat(tracks):
    def asked():
        raise AssertionError

    for u in (100, 101):
        tracks.observe(*frame_of({1: u, 2: u + 100}), asked)


@pytest.mark.parametrize("row", range(4))
def test_a_copy_repeats_all_four_pixels(tracks, row):
    ids, pixels = frame_of({1: 100, 2: 200})
    tracks.observe(ids, pixels, lambda: True)
    moved = pixels.copy()
    moved[:, row] += np.float32(1e-3)
    assert not tracks.observe(ids, moved, lambda: True).frozen
    assert tracks.observe(ids, moved, lambda: True).frozen


def test_the_last_pixels_are_those_of_the_last_frame_alone():
    tracks = Tracks(retire_after=3, frozen_share=0.5)
    assert tracks.last_pixels().shape == (0, 4)
    observe(tracks, {1: 100, 2: 200, 5: 500})
    assert tracks.last_pixels()[:, 0].tolist() == [100, 200, 500]
    observe(tracks, {5: 501, 1: 101})
    assert tracks.last_pixels()[:, 0].tolist() == [101, 501]
    observe(tracks, {2: 202})
    assert tracks.last_pixels()[:, 0].tolist() == [202]
    observe(tracks, {})
    assert tracks.last_pixels().shape == (0, 4)


def test_continuity_can_be_turned_off():
    tracks = Tracks(retire_after=1, frozen_share=None)
    _, first = observe(tracks, {1: 100, 2: 200})
    frame, second = observe(tracks, {1: 100, 2: 200})
    assert not frame.frozen
    assert second == first


def test_an_unseen_track_ends_and_its_id_begins_anew(tracks):
    _, first = observe(tracks, {1: 100, 2: 200})
    frame, _ = observe(tracks, {1: 101})
    assert frame.ended.tolist() == [first[2]]
    frame, back = observe(tracks, {1: 102, 2: 202})
    assert back[2] != first[2]
    assert tracks.identity(np.array([back[2]]))[1].tolist() == [1]


def test_retire_after_bridges_short_gaps():
    tracks = Tracks(retire_after=2, frozen_share=0.5)
    _, first = observe(tracks, {1: 100, 2: 200})
    assert not len(observe(tracks, {1: 101})[0].ended)
    assert observe(tracks, {1: 102, 2: 202})[1] == first
    observe(tracks, {1: 103})
    assert observe(tracks, {1: 104})[0].ended.tolist() == [first[2]]


def test_no_track_outlasts_frames_that_are_missing(tracks):
    _, first = observe(tracks, {1: 100, 2: 200})
    frame, second = observe(tracks, {1: 101, 2: 200, 3: 300}, missed=1)
    assert sorted(frame.ended.tolist()) == sorted(first.values())
    assert not set(second.values()) & set(first.values())
    assert not frame.frozen
    assert tracks.identity(np.array([second[1]]))[1].tolist() == [1]


def test_missing_frames_count_as_frames_without_an_observation():
    tracks = Tracks(retire_after=3, frozen_share=0.5)
    _, first = observe(tracks, {1: 100, 2: 200})
    _, second = observe(tracks, {1: 101}, missed=1)
    assert second[1] == first[1]
    frame, third = observe(tracks, {1: 102, 2: 202}, missed=1)
    assert third[1] == first[1]
    assert third[2] != first[2]
    assert frame.ended.tolist() == [first[2]]


def test_pixels_of_before_a_gap_are_no_copies():
    tracks = Tracks(retire_after=2, frozen_share=0.5)
    _, first = observe(tracks, {1: 100, 2: 200})
    observe(tracks, {1: 101})
    frame, second = observe(tracks, {1: 102, 2: 200})
    assert not frame.frozen
    assert second == first


def test_a_track_that_is_back_at_its_old_pixels_is_no_copy_even_in_a_frozen_frame():
    tracks = Tracks(retire_after=2, frozen_share=0.5)
    _, first = observe(tracks, {1: 100, 2: 200, 3: 300})
    observe(tracks, {1: 101, 2: 201})
    frame, keys = observe(tracks, {1: 101, 2: 201, 3: 300})
    assert frame.frozen
    assert keys[3] == first[3]
    assert frame.copied.tolist() == [key != keys[3] for key in frame.keys.tolist()]


def test_a_rejected_point_begins_anew_when_seen_again(tracks):
    _, first = observe(tracks, {1: 100, 2: 200})
    tracks.restart(np.array([first[1]]), rest=True)
    frame, second = observe(tracks, {1: 101, 2: 201})
    assert second[1] != first[1]
    assert second[2] == first[2]
    assert not len(frame.ended)


def test_rejected_tracks_still_tell_a_frozen_frame(tracks):
    _, first = observe(tracks, {1: 100, 2: 200})
    tracks.restart(np.array(list(first.values())), rest=True)
    assert observe(tracks, {1: 100, 2: 200})[0].frozen


@pytest.fixture
def resting_tracks():
    """Track 1 of three is to rest for two frames."""
    tracks = Tracks(retire_after=1, frozen_share=0.5, rest_after_rejection=2)
    _, first = observe(tracks, {1: 100, 2: 200, 3: 300})
    tracks.restart(np.array([first[1]]), rest=True)
    return tracks


def test_a_rejected_track_is_left_out_while_it_rests(resting_tracks):
    for k in (1, 2):
        frame, keys = observe(resting_tracks, {1: 100 + k, 2: 200 + k, 3: 300 + k})
        assert sorted(keys) == [2, 3]
        assert sorted(frame.pixels[:, 0]) == [200 + k, 300 + k]
    _, keys = observe(resting_tracks, {1: 103, 2: 203, 3: 303})
    assert sorted(keys) == [1, 2, 3]
    assert resting_tracks.identity(np.array([keys[1]]))[1] == [1]


def test_a_resting_track_that_jumps_to_another_point_begins_there(resting_tracks):
    frame, keys = observe(resting_tracks, {1: 100, 2: 200, 3: 301})
    assert frame.frozen
    assert sorted(keys) == [1, 2, 3]
    assert frame.copied.tolist() == [key in (keys[1], keys[2]) for key in frame.keys.tolist()]


def test_a_track_that_has_jumped_is_followed_from_then_on(resting_tracks):
    _, keys = observe(resting_tracks, {1: 100, 2: 200, 3: 301})
    for k in (1, 2, 3):
        assert observe(resting_tracks, {1: 100 + k, 2: 200 + k, 3: 301 + k})[1] == keys


def test_an_id_that_comes_back_has_rested_enough(resting_tracks):
    observe(resting_tracks, {2: 201, 3: 301})
    assert sorted(observe(resting_tracks, {1: 102, 2: 202, 3: 302})[1]) == [1, 2, 3]


def test_a_track_rests_only_where_it_is_told_to(resting_tracks):
    _, keys = observe(resting_tracks, {1: 101, 2: 201, 3: 301})
    resting_tracks.restart(np.array([keys[2]]), rest=False)
    assert sorted(observe(resting_tracks, {1: 102, 2: 202, 3: 302})[1]) == [2, 3]


def test_an_empty_frame_is_a_frame(tracks):
    _, first = observe(tracks, {1: 100})
    frame, _ = observe(tracks, {})
    assert frame.ended.tolist() == list(first.values())
    assert tracks.ids_seen == 1


def test_slots_are_found_in_a_table_of_any_order():
    assert indices_of(np.array([5, 2, 9]), np.array([9, 5, 7, 2])).tolist() == [1, 3, 0]


def test_keys_that_are_not_in_a_table_have_no_place():
    table, none = np.array([9, 5, 7, 2]), np.empty(0, dtype=np.int64)
    keys = np.array([8, 2, 10, 9, 1])
    assert indices_of(keys, table).tolist() == [-1, 3, -1, 0, -1]
    assert is_member(keys, table).tolist() == [False, True, False, True, False]
    assert not is_member(keys, none).any()
    assert indices_of(none, table).shape == (0,)


def test_a_track_out_of_sight_keeps_its_key_until_it_is_retired():
    tracks = Tracks(retire_after=3, frozen_share=None)
    _, first = observe(tracks, {5: 100, 1: 200, 9: 300})
    for u in (301, 302):
        frame, _ = observe(tracks, {9: u, 3: u + 50})
        assert not len(frame.ended)
    frame, last = observe(tracks, {1: 203, 3: 353, 9: 303})
    assert (last[1], last[9]) == (first[1], first[9])
    assert frame.ended.tolist() == [first[5]]
