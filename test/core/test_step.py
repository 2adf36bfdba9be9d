# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

from vislam_ros.core.columns import Estimate, Quantity
from vislam_ros.core.step import COLUMNS, SlamStep, StepTotals, estimates_of, percentile

WIND = Quantity("wind", "m/s", "of the air", ("x", "y"))
STEP = SlamStep(
    stamp=5,
    frozen=True,
    active=40,
    used=30,
    rejected=10,
    observed=45,
    admitted=3,
    landmarks=200,
    nis=45.0,
    nis_dof=90,
    ms=2.0,
    tracks=70,
    first_of_pass=False,
    left_out=0,
    position=np.zeros(3),
    quaternion=np.array([0.0, 0.0, 0.0, 1.0]),
    covariance=np.eye(6),
    twist=np.arange(6.0),
    twist_covariance=np.diag([1.0, 4.0, 9.0, 0.01, 0.04, 0.09]),
    T_map_odom=np.eye(4),
    estimates=(Estimate(WIND, [7.0, 8.0], [0.7, 0.8]),),
)


def test_every_column_is_a_number_with_a_meaning():
    assert {column.kind for column in COLUMNS} == {int, float, bool}
    assert all(column.meaning for column in COLUMNS)
    # Tables of earlier versions begin so, and their readers look for that.
    first = "stamp frozen active used rejected observed admitted landmarks nis nis_dof ms"
    assert [column.name for column in COLUMNS][:11] == first.split()


def test_the_row_of_a_step_holds_its_columns_its_twist_and_what_the_estimator_tells():
    row = STEP.row()
    assert list(row)[: len(COLUMNS)] == [column.name for column in COLUMNS]
    assert all(type(row[column.name]) is column.kind for column in COLUMNS)
    assert (row["stamp"], row["frozen"], row["nis_dof"]) == (5, True, 90)
    expected = {
        "velocity": (0.0, 1.0, 2.0),
        "velocity_std": (1.0, 2.0, 3.0),
        "angular_velocity": (3.0, 4.0, 5.0),
        "angular_velocity_std": (0.1, 0.2, 0.3),
        "wind": (7.0, 8.0),
        "wind_std": (0.7, 0.8),
    }
    names = [f"{name}_{axis}" for name in expected for axis in "xyz"[: len(expected[name])]]
    assert list(estimates_of(row)) == names
    assert list(estimates_of(row).values()) == pytest.approx(sum(expected.values(), ()))


def test_pandas_takes_steps_as_a_table_with_a_column_a_field():
    pandas = pytest.importorskip("pandas")
    steps = (STEP, dataclasses.replace(STEP, stamp=6, nis=50.0))
    table = pandas.DataFrame(steps)
    assert list(table.columns) == [field.name for field in dataclasses.fields(SlamStep)]
    numbers = table.select_dtypes(["number", "bool"])
    assert list(numbers.columns) == [column.name for column in COLUMNS]
    assert table.nis.sum() == 95.0
    assert pandas.DataFrame([step.row() for step in steps]).wind_std_y.tolist() == [0.8, 0.8]


def test_totals_are_the_same_step_by_step_and_of_a_table():
    rows = [
        dataclasses.replace(STEP, frozen=k == 1, used=30 * k, ms=float(k)).row() for k in range(3)
    ]
    totals = StepTotals()
    for row in rows:
        totals.add(row)
    assert (totals.steps, totals.frozen_steps, totals.observations) == (3, 1, 135)
    assert totals.rejected_fraction == 30 / (30 + 90)
    assert totals.nis_per_dof == 0.5
    assert totals.ms_percentile(50) == 1.0
    assert (
        StepTotals.of_table({name: np.array([row[name] for row in rows]) for name in row})
        == totals
    )


def test_nothing_is_claimed_of_no_steps():
    totals = StepTotals()
    assert totals.rejected_fraction is totals.nis_per_dof is totals.ms_percentile(99) is None
    assert percentile([], 50) is None
