# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from typing import Any

import pytest
from benchmark.battery.rows import BatteryRow, Recorded, Simulated
from benchmark.battery.summary import failures, is_worse, summed_groups, summed_rows
from benchmark.battery.trials import trials_of

from vislam_ros.data.sweeps.run import Row

ROWS: list[BatteryRow] = [Simulated("walk", 6), Recorded("0022", 3), Simulated("walk", 20)]
TRIALS = trials_of(ROWS, 2)


def figures(dead_reckoning: float, estimate: float, **others: Any) -> Row:
    """Errors in per cent, and as many metres; smoothed has half of them."""
    errors = {"dead_reckoning": dead_reckoning, "estimate": estimate, "smoothed": estimate / 2}
    return {
        "error": None,
        **{f"{name}_{unit}": error for name, error in errors.items() for unit in ("percent", "m")},
        "estimate_ate_m": 3.0,
        "estimate_nees": 2.0,
        **others,
    }


def with_keys(rows: list[Row]) -> dict[str, Row]:
    return {trial.key: {"key": trial.key, **row} for trial, row in zip(TRIALS, rows, strict=True)}


FOUND = with_keys(
    [
        figures(1.0, 2.0, gyro_bias_x=0.01, gyro_bias_y=-0.03, gyro_bias_z=0.0),
        figures(3.0, 4.0, gyro_bias_x=0.02, gyro_bias_y=0.0, gyro_bias_z=0.0),
        figures(8.0, 2.0),
        {"error": "ValueError: no"},
        figures(1.0, 1.0),
        figures(1.0, 1.0),
    ]
)


@pytest.mark.parametrize(
    ("estimate", "dead_reckoning", "worse"),
    [(1.07, 1.0, False), (1.0701, 1.0, True), (0.02, 0.0, False), (0.03, 0.0, True)],
)
def test_an_estimate_is_worse_above_a_twentieth_and_two_centimetres(
    estimate: float, dead_reckoning: float, worse: bool
) -> None:
    assert is_worse(estimate, dead_reckoning) is worse


def test_a_row_is_the_mean_over_its_seeds_that_ended_well() -> None:
    walk, other_walk, recorded = summed_rows(ROWS, TRIALS, FOUND)
    assert [row["name"] for row in (walk, other_walk, recorded)] == [
        "simulated walk, 6 features, 10 Hz",
        "simulated walk, 20 features, 10 Hz",
        "0022, 3 %",
    ]
    assert (walk["seeds"], walk["failed"]) == (2, 0)
    assert walk["dead_reckoning_percent"] == 2.0
    assert walk["estimate_percent"] == 3.0
    assert walk["to_dead_reckoning"] == 1.5
    assert walk["gyro_bias_max"] == 0.03
    assert walk["worse"] is True
    assert (recorded["seeds"], recorded["failed"]) == (1, 1)
    assert recorded["estimate_percent"] == 2.0
    assert recorded["gyro_bias_max"] is None
    assert recorded["worse"] is False
    assert recorded["beside_percent"] is None


def test_groups_have_geometric_means_and_counts() -> None:
    walks, recorded, everything = summed_groups(summed_rows(ROWS, TRIALS, FOUND))
    assert (walks["name"], recorded["name"]) == ("simulated walks", "whole drives")
    assert everything["name"] == "all"
    assert [group["rows"] for group in (walks, recorded, everything)] == [2, 1, 3]
    assert [group["worse"] for group in (walks, recorded, everything)] == [1, 0, 1]
    assert walks["to_dead_reckoning"] == pytest.approx(math.sqrt(1.5))
    assert everything["to_dead_reckoning"] == pytest.approx((1.5 * 0.25 * 1.0) ** (1 / 3))
    assert everything["smoothed_to_dead_reckoning"] == pytest.approx((0.375 / 8) ** (1 / 3))
    assert everything["to_beside"] is None


def test_another_battery_is_compared_over_the_seeds_that_both_have() -> None:
    others = with_keys(
        [figures(1.0, 8.0), {"error": "no"}, figures(8.0, 1.0), figures(8.0, 9.0)]
        + [figures(1.0, 1.0)] * 2
    )
    del others[TRIALS[4].key], others[TRIALS[5].key]
    summed = summed_rows(ROWS, TRIALS, FOUND, others)
    assert [row["beside_percent"] for row in summed] == [8.0, None, 1.0]
    assert [row["to_beside"] for row in summed] == [0.25, None, 2.0]
    everything = summed_groups(summed)[-1]
    assert everything["to_beside"] == pytest.approx(math.sqrt(0.5))
    assert everything["smoothed_to_beside"] == pytest.approx(math.sqrt(0.5))


def test_trials_that_failed_are_named_and_a_row_of_them_alone_is_no_mean() -> None:
    (text,) = failures(TRIALS, FOUND)
    assert text == "0022, 3 %, seed 1: ValueError: no"
    (row,) = summed_rows(ROWS[1:2], TRIALS[3:4], FOUND)
    assert (row["seeds"], row["failed"]) == (0, 1)
    assert row["estimate_percent"] is row["to_dead_reckoning"] is row["worse"] is None
