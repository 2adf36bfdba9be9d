# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
from numpy.testing import assert_array_equal

from vislam_ros.core.linalg.scatter import put, put_both

ROWS, COLUMNS = np.array([6, 0, 3]), np.array([1, 2, 7, 5])


def test_a_block_stands_where_numpy_would_put_it() -> None:
    rng = np.random.default_rng(3)
    matrix, block = rng.normal(size=(8, 8)), rng.normal(size=(3, 4))
    expected = matrix.copy()
    expected[np.ix_(ROWS, COLUMNS)] = block
    put(block, ROWS, COLUMNS, matrix)
    assert_array_equal(matrix, expected)


def test_a_block_of_a_symmetric_matrix_stands_on_both_sides() -> None:
    rng = np.random.default_rng(4)
    matrix, block = rng.normal(size=(8, 8)), rng.normal(size=(3, 4))
    matrix = matrix + matrix.T
    expected = matrix.copy()
    expected[np.ix_(ROWS, COLUMNS)] = block
    expected[np.ix_(COLUMNS, ROWS)] = block.T
    put_both(block, ROWS, COLUMNS, matrix)
    assert_array_equal(matrix, expected)
    assert_array_equal(matrix, matrix.T)
