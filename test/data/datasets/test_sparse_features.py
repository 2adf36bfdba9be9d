# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The dense array's observations, whatever its order, type and chunks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vislam_ros.data.datasets.arrays.array_stream import ArrayStream
from vislam_ros.data.datasets.sparse_features import gather_observations, rectified
from vislam_ros.data.drive import image_size_that_holds


def stream(dense, *, fortran_order=False, chunk=7):
    flat = dense.reshape(-1, order="F" if fortran_order else "C")
    chunks = (flat[start : start + chunk] for start in range(0, len(flat), chunk))
    return ArrayStream(dense.shape, fortran_order, dense.dtype, dense.nbytes, "features", chunks)


def by_loops(dense):
    """The specification: every observed (step, id) with its pixels."""
    _, M, T = dense.shape
    return [
        (t, m, tuple(np.float32(dense[:, m, t])))
        for t in range(T)
        for m in range(M)
        if not set(dense[:, m, t]) <= {-1.0, 0.0}
    ]


@given(
    seed=st.integers(0, 2**32 - 1),
    M=st.integers(0, 6),
    T=st.integers(1, 6),
    chunk=st.integers(1, 200),
    fortran_order=st.booleans(),
    dtype=st.sampled_from(["<f8", "<f4", ">f8"]),
)
@settings(deadline=None)
def test_agrees_with_a_loop_over_the_dense_array(seed, M, T, chunk, fortran_order, dtype):
    rng = np.random.default_rng(seed)
    # Single pixels of -1 or 0 in a seen observation are pixels, too.
    dense = rng.choice([-1.0, -3.5, 0.0, 100.25, 1e3 / 3], (4, M, T)).astype(dtype)
    dense[:, rng.random((M, T)) < 0.5] = rng.choice([-1.0, 0.0])
    features = rectified(
        gather_observations(lambda: stream(dense, fortran_order=fortran_order, chunk=chunk))
    )
    steps = np.repeat(np.arange(T), np.diff(features.offsets))
    found = list(zip(steps, features.ids, map(tuple, features.pixels), strict=True))
    assert found == by_loops(dense)
    assert features.unusable == 0
    assert features.ids.dtype == np.uint32
    assert features.pixels.dtype == np.float32
    assert features.offsets.shape == (T + 1,)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, 1e7])
def test_an_observation_with_an_unusable_pixel_is_dropped_and_counted(bad):
    dense = np.full((4, 2, 3), -1.0)
    dense[:, 0, 1] = dense[:, 1, 1] = [10, 20, 5, 20]
    dense[2, 0, 1] = bad
    features = rectified(gather_observations(lambda: stream(dense)))
    assert features.unusable == 1
    np.testing.assert_array_equal(features.ids, [1])
    np.testing.assert_array_equal(features.offsets, [0, 0, 1, 1])


def test_tells_how_far_it_is():
    shares = []
    gather_observations(lambda: stream(np.full((4, 5, 5), -1.0), chunk=50), shares.append)
    assert shares == [0.5, 1.0]


@pytest.mark.parametrize(
    ("pixels", "size"),
    [
        (np.empty((0, 4)), (1, 1)),
        ([[-5, -7, -9, -7]], (1, 1)),
        ([[10.0, 3.5, 2.0, 3.25], [4.0, 8.999, 11.5, 9.0]], (12, 10)),
    ],
)
def test_the_image_is_the_smallest_that_holds_all_pixels(pixels, size):
    assert image_size_that_holds(np.array(pixels, dtype=np.float32)) == size


def test_entries_of_zeros_are_unobserved_and_counted():
    dense = np.zeros((4, 5, 6))
    dense[:, 2, 1] = [30.0, 0.0, 20.0, 0.0]
    dense[:, 3, 4] = -1
    features = gather_observations(lambda: stream(dense))
    assert features.ids.tolist() == [2]
    assert features.pixels.tolist() == [[30.0, 0.0, 20.0, 0.0]]
    assert features.empty == 28
