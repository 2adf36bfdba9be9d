# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.track_noise import TrackNoise

Array = NDArray[np.float64]

PRIOR = np.array([1.0, 1.0, 0.5])
TRACKS, LENGTH = 60, 12


def track_noise(offset_std: float = 0.5) -> TrackNoise:
    return TrackNoise(PRIOR, offset_std, FrameRate(), learns=True)


def update(noise: TrackNoise, residual: Array, state: float = 0.0) -> None:
    """Update by residuals (n, 3) of all landmarks, whose points have a variance."""
    used = noise.components
    indices = np.arange(len(residual))
    variances = noise.variances(indices)
    S = (variances + state)[:, used].ravel()
    noise.update(indices, residual, variances, 1 / S, residual[:, used].ravel() / S)


def learned(frames: int, std: Array | float, offset: float = 0.0, seed: int = 51) -> TrackNoise:
    """Feed the noise tracks that all begin and end together, each with a deviation (n,)."""
    rng = np.random.default_rng(seed)
    noise = track_noise()
    for k in range(frames):
        if k % LENGTH == 0:
            noise.remove(np.ones(TRACKS if k else 0, dtype=bool))
            noise.add(TRACKS)
            stays = np.outer(offset * rng.standard_normal(TRACKS), [0.0, 1.0, 0.0])
        white = np.sqrt(PRIOR) * rng.standard_normal((TRACKS, 3))
        update(noise, np.reshape(std, (-1, 1)) * white + stays)
    return noise


@pytest.mark.parametrize("std", [0.2, 0.5, 1.0, 3.0])
def test_the_level_of_the_noise_is_found(std: float) -> None:
    # The tracks' own scales are estimates, and each takes its part of the noise.
    assert_allclose(np.sqrt(learned(6000, std).level), std, rtol=0.1)


def test_a_tracks_own_noise_is_found_beside_the_others() -> None:
    std = np.where(np.arange(TRACKS) < 6, 3.0, 0.7)
    noise = learned(LENGTH, std)
    own = noise.variances(np.arange(TRACKS))
    assert np.all(own[:6, 0] > 2 * np.max(own[6:, 0]))
    assert_allclose(own, own[:, :1] * PRIOR)
    # Without observations, a new track has the level of all.
    noise.add(1)
    assert_allclose(noise.variances(np.array([TRACKS]))[0], noise.level * PRIOR)


def test_noise_that_a_track_has_is_kept_apart_from_what_its_point_lacks() -> None:
    rng = np.random.default_rng(52)
    noise = track_noise()
    noise.add(4000)
    for _ in range(4):
        state = 3.0 * rng.standard_normal((4000, 3))
        update(noise, np.sqrt(PRIOR) * rng.standard_normal((4000, 3)) + state, 9.0)
    own = noise.variances(np.arange(4000))[:, 0] / noise.level
    assert_allclose(np.mean(own), 1.0, atol=0.03)


def test_white_errors_of_disparities_are_no_offsets() -> None:
    noise = learned(100, 1.0)
    assert not noise.has_offsets
    assert_array_equal(noise.components, [0, 1, 2])
    y = np.array([[600.0, 590.0, 150.0]])
    assert_allclose(noise.of_new_tracks(y)[0], np.diag(noise.level * PRIOR))
    assert_allclose(noise.expected(np.ones((1, 3)), y), 1.0)
    assert noise.gate(16.27) == 16.27


def test_errors_that_stay_are_offsets_and_leave_the_right_pixel_out() -> None:
    noise = learned(100, 0.1, offset=0.6)
    assert noise.has_offsets
    assert_array_equal(noise.components, [0, 2])
    y = np.array([[600.0, 590.0, 150.0]])
    (first,) = noise.of_new_tracks(y)
    # Left and right are off alike, but for the offset: half a pixel and a fiftieth of ten.
    together = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.5]])
    assert_allclose(first, noise.level * together + np.diag([0.0, 0.5**2 + 0.2**2, 0.0]))
    assert np.all(np.linalg.eigvalsh(first) > 0)
    assert_allclose(noise.expected(np.ones((1, 3)), y), [[1.0, 1.29, 1.0]])
    assert noise.gate(16.0) == 24.0
    assert noise.gate(0.0) == 0.0


def test_where_no_offset_is_looked_for_there_is_none() -> None:
    noise = TrackNoise(PRIOR, 0.0, FrameRate(), learns=True)
    noise.add(TRACKS)
    error = np.random.default_rng(53).standard_normal((TRACKS, 3))
    for _ in range(50):
        update(noise, error)
    assert not noise.has_offsets


def test_the_level_begins_where_the_rows_of_left_and_right_differ_by_more_than_the_prior() -> None:
    mismatch = np.random.default_rng(54).standard_normal(2000)
    noise = track_noise()
    # A camera that is not quite level moves them all alike.
    noise.initialize_level(3.0 * mismatch + 5.0)
    assert_allclose(noise.level, 9.0, rtol=0.1)
    noise.initialize_level(0.2 * mismatch)
    assert_allclose(noise.level, 9.0, rtol=0.1)


def test_rows_that_agree_or_are_few_or_late_do_not_change_the_level() -> None:
    noise = track_noise()
    noise.initialize_level(np.linspace(-0.3, 0.3, 100))
    noise.initialize_level(np.linspace(-9.0, 9.0, 10))
    assert noise.level == 1.0
    noise.add(TRACKS)
    update(noise, np.ones((TRACKS, 3)))
    level = noise.level
    noise.initialize_level(np.linspace(-9.0, 9.0, 100))
    assert noise.level == level


@pytest.mark.parametrize("state", [0.0, 4.0, 25.0])
def test_the_level_is_found_as_fast_where_innovations_are_mostly_of_the_state(
    state: float,
) -> None:
    rng = np.random.default_rng(55)
    noise = track_noise(0.0)
    noise.add(2000)
    for _ in range(100):
        # All of the noise is the level's: the tracks are alike.
        noise.remove(np.ones(2000, dtype=bool))
        noise.add(2000)
        white = np.sqrt(4.0 * PRIOR + state) * rng.standard_normal((2000, 3))
        update(noise, white, state)
    assert_allclose(noise.level, 4.0, rtol=0.2)


def test_noise_that_is_held_stays_at_its_prior() -> None:
    noise = TrackNoise(PRIOR, 0.5, FrameRate(), learns=False)
    noise.initialize_level(np.linspace(-9.0, 9.0, 100))
    noise.add(TRACKS)
    for _ in range(50):
        update(noise, np.full((TRACKS, 3), 0.3))
    assert noise.level == 1.0
    assert not noise.has_offsets
    assert_array_equal(noise.variances(np.arange(TRACKS)), np.tile(PRIOR, (TRACKS, 1)))


def test_what_is_known_of_a_track_follows_it_when_others_end() -> None:
    noise = track_noise()
    noise.add(3)
    update(noise, np.array([[0.1] * 3, [5.0] * 3, [1.0] * 3]))
    before = noise.variances(np.arange(3))
    noise.remove(np.array([True, False, False]))
    assert_array_equal(noise.variances(np.arange(2)), before[1:])
    # In any order, and beside a new one.
    noise.add(1)
    assert_array_equal(noise.variances(np.array([1, 0])), before[[2, 1]])


def test_no_noise_and_wild_noise_keep_a_level_within_bounds() -> None:
    for size, bound in ((0.0, 1e-4), (1e9, 1e4)):
        noise = track_noise()
        for _ in range(3000):
            noise.add(8)
            update(noise, np.full((8, 3), size))
            noise.remove(np.ones(8, dtype=bool))
        assert_allclose(noise.level, bound, rtol=1e-9)


def test_the_level_follows_within_half_a_minute_at_any_rate(rate: FrameRate) -> None:
    noise = TrackNoise(PRIOR, 0.0, rate, learns=True)
    for seconds, square in ((60, 1.0), (30, 1.1)):
        for _ in range(seconds * rate.hertz):
            noise.add(8)
            update(noise, np.tile(np.sqrt(square * PRIOR), (8, 1)))
            noise.remove(np.ones(8, dtype=bool))
    assert_allclose(noise.level - 1.0, 0.1 * (1 - np.exp(-1)), rtol=0.03)


def test_one_frame_moves_scale_and_level_as_the_equations_say() -> None:
    noise = track_noise(0.0)
    noise.add(2)
    residual, state = np.array([[1.0, -2.0, 0.5], [0.3, 0.1, -0.2]]), 3.0
    S = PRIOR + state
    update(noise, residual, state)
    w, from_noise = residual / S, np.sum(PRIOR / S)
    excess = np.sum(residual**2 / S) - 6
    # The prior of the level counts as 25 frames, that of a scale as six numbers.
    assert_allclose(noise.level, np.exp(excess / (26 * 2 * from_noise)))
    scales = (6 + w**2 @ PRIOR - from_noise + 3) / 9
    assert_allclose(noise.variances(np.arange(2)), noise.level * scales[:, None] * PRIOR)

    level, scale = noise.level, scales[0]
    S = level * scale * PRIOR + state
    noise.remove(np.array([False, True]))
    update(noise, residual[:1], state)
    w, from_noise = residual[0] / S, scale * np.sum(level * PRIOR / S)
    excess = np.sum(residual[0] ** 2 / S) - 3
    assert_allclose(noise.level, level * np.exp(excess / (27 * from_noise)))
    expected = scale * (scale * (w**2 @ (level * PRIOR)) - from_noise + 3)
    assert_allclose(
        noise.variances(np.arange(1))[0], noise.level * (9 * scale + expected) / 12 * PRIOR
    )


def test_no_frame_changes_the_logarithm_of_the_level_by_more_than_a_third_or_so() -> None:
    noise = track_noise(0.0)
    noise.add(TRACKS)
    update(noise, np.full((TRACKS, 3), 1e4))
    assert_allclose(noise.level, np.exp(0.3))


def test_twenty_rows_tell_where_the_level_begins() -> None:
    mismatch = np.linspace(-5.7, 5.7, 20)
    few, enough, wild = track_noise(), track_noise(), track_noise()
    few.initialize_level(mismatch[:19])
    enough.initialize_level(mismatch)
    wild.initialize_level(1e6 * mismatch)
    assert few.level == 1.0
    # Half of them are nearer to the middle than three.
    assert_allclose(enough.level, (3 * 1.4826) ** 2)
    assert_allclose(wild.level, 1e4)


def stays(noise: TrackNoise, first: float, then: float, tracks: int) -> None:
    """Let the disparities of new tracks be off by this, and then by that."""
    noise.add(tracks)
    for error in (first, then):
        update(noise, np.tile([0.5 * error, -0.5 * error, 0.0], (tracks, 1)))
    noise.remove(np.ones(tracks, dtype=bool))


@pytest.mark.parametrize("then", [0.55, 1.45])
def test_four_errors_that_stay_are_the_proof_that_was_missing(then: float) -> None:
    for tracks, proven in ((3, False), (4, True)):
        noise = track_noise()
        stays(noise, 1.0, then, tracks)
        assert noise.has_offsets is proven


@pytest.mark.parametrize("then", [-1.0, 0.45, 1.55])
def test_errors_that_change_by_half_of_themselves_prove_nothing(then: float) -> None:
    noise = track_noise()
    stays(noise, 1.0, then, 100)
    assert not noise.has_offsets
    # And count against what comes.
    stays(noise, 1.0, 1.0, 4)
    assert not noise.has_offsets


def test_a_first_error_is_compared_with_nothing() -> None:
    noise = track_noise()
    noise.add(100)
    update(noise, np.tile([1.0, 0.0, 0.0], (100, 1)))
    noise.remove(np.ones(100, dtype=bool))
    stays(noise, 1.0, 1.0, 4)
    assert noise.has_offsets


def test_five_thousand_errors_are_remembered() -> None:
    noise = track_noise()
    for _ in range(400):
        stays(noise, 1.0, -1.0, 100)
    # Each time 60 of 5000 are forgotten: 1 - (1 - 60 / 5000)^36 is the first share above 0.35.
    for times in range(1, 37):
        stays(noise, 1.0, 1.0, 60)
        assert noise.has_offsets is (times == 36)


def test_where_errors_are_white_each_observation_tells_something_of_its_own() -> None:
    noise = track_noise()
    assert 8.0 < noise.observations_per_independent < 10.0  # until it is seen
    noise.add(100)
    rng = np.random.default_rng(27)
    for _ in range(60):
        error = rng.standard_normal(100)
        update(noise, np.column_stack([error, np.zeros((100, 2))]))
    assert_allclose(noise.observations_per_independent, 1.0, atol=0.2)


def test_where_errors_stay_ten_observations_tell_as_much_as_one() -> None:
    noise = track_noise()
    stays(noise, 1.0, 1.0, 100)
    assert noise.has_offsets
    assert noise.observations_per_independent == 10.0


def scales_with_tails(
    noise: TrackNoise, residual: Array, S: Array, own: Array
) -> tuple[Array, Array]:
    """Variances (n, 3) with tails, and the scales of a plain loop over all the observations."""
    n = len(residual)
    inverse = np.asarray(np.linalg.inv(S), dtype=np.float64)
    variances = noise.variances(np.arange(n))
    found = noise.with_tails(np.arange(n), variances, inverse, inverse @ residual.ravel())
    plain = []
    for i in range(n):
        mine = np.arange(3 * i, 3 * i + 3)
        others = np.setdiff1d(np.arange(3 * n), mine)
        gain = S[np.ix_(mine, others)] @ np.linalg.inv(S[np.ix_(others, others)])
        error = residual[i] - gain @ residual.ravel()[others]
        R_0 = noise.level * np.diag(PRIOR)
        A = S[np.ix_(mine, mine)] - gain @ S[np.ix_(others, mine)] - own[i] * R_0
        s = own[i]
        for _ in range(6):
            information = np.linalg.inv(A + s * R_0)
            w = information @ error
            of_noise = s**2 * w @ R_0 @ w + s * (3 - s * np.trace(information @ R_0))
            # The track's own scale counts as six numbers.
            s = max(own[i], (6 * own[i] + of_noise) / 9)
        plain.append(s if s >= 1.5 * own[i] else own[i])
    return found, np.array(plain)


def judged_together(seed: int, wrong: float = 0.0) -> tuple[Array, Array, Array, TrackNoise]:
    """Innovations (12, 3) of tracks that share a motion, the first being off by so much."""
    rng = np.random.default_rng(seed)
    noise = track_noise()
    noise.add(12)
    # Tracks of different quality.
    update(noise, rng.standard_normal((12, 3)) * np.linspace(0.3, 2.0, 12)[:, None])
    own: Array = noise.variances(np.arange(12))[:, 0] / (noise.level * PRIOR[0])
    shared = rng.standard_normal((36, 6))
    S = 20.0 * shared @ shared.T + np.diag(noise.variances(np.arange(12)).ravel())
    residual = (np.linalg.cholesky(S) @ rng.standard_normal(36)).reshape(12, 3)
    residual[0, 0] += wrong
    return residual, S, own, noise


@pytest.mark.parametrize("wrong", [0.0, 5.0])
def test_observations_have_the_scales_of_a_plain_loop(wrong: float) -> None:
    residual, S, own, noise = judged_together(61, wrong)
    variances, scales = scales_with_tails(noise, residual, S, own)
    assert_allclose(variances, noise.level * scales[:, None] * PRIOR, rtol=1e-9)
    assert np.all(scales >= own)
    assert len(np.unique(own)) == 12


def test_what_is_far_off_counts_for_less_and_what_is_honest_for_nearly_as_much_as_before() -> None:
    shares = {
        wrong: np.mean([tails(61 + seed, wrong) for seed in range(50)], axis=0)
        for wrong in (0.0, 20.0)
    }
    assert np.all(shares[0.0] < 1.2)
    assert shares[20.0][0] > 5.0
    # It makes others look wrong, too, as each is judged by all, but by far less.
    assert shares[20.0][0] > 3 * np.max(shares[20.0][1:])


def tails(seed: int, wrong: float) -> Array:
    """By how much (12,) the variances of observations are larger than their tracks'."""
    residual, S, own, noise = judged_together(seed, wrong)
    variances, _ = scales_with_tails(noise, residual, S, own)
    ratio: Array = variances[:, 0] / (noise.level * PRIOR[0]) / own
    return ratio


def test_of_right_observations_few_are_taken_for_far_off() -> None:
    ratios = np.array([tails(61 + seed, 0.0) for seed in range(200)])
    assert np.mean(ratios > 1.0) < 0.1


def test_the_farther_off_the_less_it_counts() -> None:
    ratios = [tails(62, wrong)[0] for wrong in (5.0, 10.0, 20.0, 40.0)]
    assert np.all(np.diff(ratios) > 0)


def test_noise_that_is_held_has_no_tails() -> None:
    noise = TrackNoise(PRIOR, 0.5, FrameRate(), learns=False)
    noise.add(2)
    variances = noise.variances(np.arange(2))
    found = noise.with_tails(np.arange(2), variances, np.eye(6), np.full(6, 100.0))
    assert_array_equal(found, variances)


def test_of_disparities_with_an_offset_tails_are_told_by_what_is_observed() -> None:
    noise = learned(100, 0.1, offset=0.6)
    noise.remove(np.ones(TRACKS, dtype=bool))
    noise.add(1)
    assert_array_equal(noise.components, [0, 2])
    R = noise.level * PRIOR[[0, 2]]
    far = np.array([8.0, 0.0]) * np.sqrt(R)
    found = noise.with_tails(np.arange(1), noise.variances(np.arange(1)), np.diag(1 / R), far / R)
    # All of the innovation is noise: s = (6 + 8^2 / 1) / 8, from the first round on.
    assert_allclose(found[0], noise.level * PRIOR * (6 + 64) / 8)
