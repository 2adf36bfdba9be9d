# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np

from vislam_ros.core.geometry import se3
from vislam_ros.frontend.turns import turn_between


def test_turns_add_up_over_whole_samples_and_parts_of_them() -> None:
    rng = np.random.default_rng(8)
    stamps = np.cumsum(rng.integers(4_000_000, 6_000_000, 50))
    omega = rng.normal(size=(50, 3))
    begin, end = int(stamps[9]) - 1_000_000, int(stamps[30]) + 2_000_000
    expected = np.eye(3)
    now = begin
    for k in range(9, 32):
        then = min(int(stamps[k]), end)
        expected = expected @ se3.exp_rotation(omega[k] * (then - now) * 1e-9)
        now = then
    middle = int(stamps[20]) + 300_000
    spans = [(begin, end), (begin, middle), (middle, end)]
    turns = [turn_between(stamps, omega, *span) for span in spans]
    whole, first, second = (turn for turn in turns if turn is not None)
    np.testing.assert_allclose(whole, expected, atol=1e-14)
    np.testing.assert_allclose(first @ second, expected, atol=1e-14)


def test_there_is_no_turn_beyond_the_motion() -> None:
    stamps, omega = np.array([100, 200, 300]), np.ones((3, 3))
    assert turn_between(stamps, omega, 99, 200) is None
    assert turn_between(stamps, omega, 200, 301) is None
    assert turn_between(stamps, omega, 100, 300) is not None
