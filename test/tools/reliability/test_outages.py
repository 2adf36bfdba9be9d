# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Holes in drives, and what they may cost."""

import numpy as np
import pytest
from reliability.outages import KINDS, Outage, measure_outages, outages

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve


@pytest.fixture(scope="module")
def drive() -> Drive:
    settings = SimulationSettings(
        steps=240, landmarks=1500, velocity_noise_std=0.5, angular_velocity_noise_std=0.05, seed=4
    )
    return simulate(settings).drive


def test_an_outage_leaves_out_one_stream_for_its_time_and_nothing_else(drive: Drive) -> None:
    for kind in KINDS:
        outage = Outage(kind, 0.5, 2.0)
        left, (begin, end) = outage.applied(drive), outage.span(drive)
        for name, missing in (("twist_stamps", "twists"), ("feature_stamps", "features")):
            stamps = getattr(drive, name)
            hole = (stamps >= begin) & (stamps < end) & (kind == missing)
            np.testing.assert_array_equal(getattr(left, name), stamps[~hole])
            assert np.count_nonzero(hole) == (20 if kind == missing else 0)
        last = left.frame(left.steps - 1)
        np.testing.assert_array_equal(last[1], drive.frame(drive.steps - 1)[1])


def test_places_are_spread_over_the_drive_for_each_kind_and_length() -> None:
    holes = outages(3, [1.0, 2.0])
    assert len(holes) == len(set(holes)) == 12
    assert all(0.0 < hole.place < 0.9 for hole in holes)


def test_across_an_outage_the_estimate_is_no_worse_than_what_is_left(drive: Drive) -> None:
    reference = drive.ground_truth
    assert reference is not None
    tasks = outages(3, [1.0, 2.0])
    settings = RobocentricSettings(), PredictionSettings()
    rows = list(measure_outages(drive, reference, *settings, tasks))
    assert {row.outage for row in rows} == set(tasks)
    assert all(row.holds for row in rows), [row.as_dict() for row in rows if not row.holds]
    # The undisturbed drive is a lucky one: its NEES/6 of 0.3 says nothing of what is too much.
    trajectory = solve(drive, *settings).trajectory
    undisturbed = compare(reference, trajectory, trajectory.covariances)["nees_per_dof"]
    nees = undisturbed * np.array([row.nees_ratio for row in rows])
    assert np.mean(nees) < 1.05
    assert np.max(nees) < 2.8


def test_what_dead_reckoning_across_a_hole_costs_the_whole_drive_stands_beside_it(
    drive: Drive,
) -> None:
    reference = drive.ground_truth
    assert reference is not None
    outage = Outage("features", 0.4, 5.0)
    settings = RobocentricSettings(), PredictionSettings()
    (row,) = measure_outages(drive, reference, *settings, [outage])
    assert row.beside_ate_ratio > 1.0
    assert row.ate_ratio <= max(2.0, 1.3 * row.beside_ate_ratio)
