# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from vislam_ros.core.linalg.scratch import FreshMemory, Scratch


def test_scratch_gives_the_same_memory_again_in_every_size():
    scratch = Scratch()
    large = scratch.matrix("a", 20, 30)
    assert np.shares_memory(large, scratch.matrix("a", 7, 5))
    assert not np.shares_memory(large, scratch.matrix("b", 7, 5))
    assert scratch.matrix("a", 100, 50).shape == (100, 50)


def test_fresh_memory_is_never_given_twice():
    fresh = FreshMemory()
    assert not np.shares_memory(fresh.matrix("a", 4, 5), fresh.matrix("a", 4, 5))
    P = np.eye(9)
    assert not np.shares_memory(fresh.successor(P, 5), fresh.successor(P, 5))
