# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows of ``steps.csv`` as a filter could have given them."""


def step_row(stamp: int, **changes: float) -> dict[str, float]:
    """Row of a step of an estimator that tells a bias."""
    row: dict[str, float] = {
        "stamp": stamp,
        "frozen": False,
        "active": 10,
        "used": 8,
        "rejected": 0,
        "observed": 12,
        "admitted": 4,
        "landmarks": 20,
        "nis": 24.0,
        "nis_dof": 24,
        "ms": 1.0,
        "tracks": 30,
        "first_of_pass": False,
        "left_out": 0,
        **{f"gyro_bias_{axis}": 0.01 * (k + 1) for k, axis in enumerate("xyz")},
        **{f"gyro_bias_std_{axis}": 1e-3 for axis in "xyz"},
    }
    assert changes.keys() <= row.keys()
    return {**row, **changes}
