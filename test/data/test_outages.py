# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A recorded camera that fails for a while."""

import numpy as np
import pytest
from places import SHARED_CASES

from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.evaluation.relative import relative_errors
from vislam_ros.data.loading import load_drive
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import Trajectory, read_tum

CASE = SHARED_CASES / "04_camera_outage_2s"
NEEDS_CASE = pytest.mark.skipif(not CASE.is_dir(), reason=f"needs the bag, which is not in {CASE}")


def error(truth: Trajectory, estimate: Trajectory, begin: int, end: int) -> float:
    """Error of the motion from the last pose at or before one stamp (ns) to that at another."""
    i, j = associate(truth, estimate)
    stamps = estimate.stamps[j]
    pair = np.array([[np.searchsorted(stamps, begin, "right") - 1, np.searchsorted(stamps, end)]])
    metres, _ = relative_errors(truth.T_world_body[i], estimate.T_world_body[j], pair)
    return float(metres[0])


@NEEDS_CASE
def test_across_a_camera_outage_the_estimate_is_about_as_good_as_dead_reckoning() -> None:
    drive, truth = load_drive(CASE / "bag"), read_tum(CASE / "s.tum")
    hole = int(np.argmax(np.diff(drive.feature_stamps)))
    last, first = drive.feature_stamps[hole : hole + 2].tolist()
    assert first - last > 2_000_000_000
    solution = solve(drive)
    for frames in range(3):
        end = int(drive.feature_stamps[hole + 1 + frames])
        estimated = error(truth, solution.trajectory, last, end)
        reckoned = error(truth, solution.dead_reckoning, last, end)
        assert estimated <= 1.2 * reckoned + 0.3
