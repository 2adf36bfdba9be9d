# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The bounds of NEES hold what they say of errors that are drawn from their covariance."""

import numpy as np
import pytest

from vislam_ros.data.evaluation.consistency import consistency_figures, nees_bounds


def test_the_bounds_are_those_of_chi_square_tables() -> None:
    # Tables of chi-square with 6 degrees of freedom: 1.237 and 14.449.
    assert nees_bounds() == pytest.approx((1.237 / 6, 14.449 / 6), rel=1e-3)


@pytest.mark.parametrize(("scale", "low", "high"), [(1.0, 0.935, 0.965), (3.0, 0.0, 0.5)])
def test_95_per_cent_of_an_honest_filters_poses_are_inside(
    scale: float, low: float, high: float
) -> None:
    xi = np.sqrt(scale) * np.random.default_rng(3).normal(size=(4000, 6))
    nees = np.append(np.mean(xi**2, axis=1), np.nan)
    figures = consistency_figures(nees)
    assert low < figures["nees_inside"] < high
    assert figures["nees_per_dof"] == pytest.approx(scale, rel=0.05)
    assert (figures["nees_poses"], figures["nees_left_out"]) == (4000, 1)


def test_the_bounds_themselves_are_inside_and_what_is_beyond_is_not() -> None:
    low, high = nees_bounds()
    nees = np.array([low, high, np.nextafter(low, 0), np.nextafter(high, 9)])
    assert consistency_figures(nees)["nees_inside"] == 0.5


def test_where_nothing_is_known_nothing_is_said() -> None:
    figures = consistency_figures(np.full(3, np.nan))
    assert figures["nees_per_dof"] is figures["nees_inside"] is None
    assert (figures["nees_poses"], figures["nees_left_out"]) == (0, 3)
