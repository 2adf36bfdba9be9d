# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest
from viewing_recorded import Recorded

from vislam_ros.data.results.growing import GrowingResults
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.viewing.live import LiveViewer
from vislam_ros.data.viewing.stream import opened_stream


def test_a_run_is_logged_as_it_grows(
    round_results: Results, round_drive: Trajectory, tmp_path: Path
) -> None:
    pytest.importorskip("rerun.chunk", reason="the extra view is not installed")
    growing = GrowingResults(round_results.directory)
    steps = growing.new_steps()
    with opened_stream("live", tmp_path / "live.rrd") as stream:
        viewer = LiveViewer(stream)
        viewer.add(round_results.directory, [])
        for part in (steps[:20], steps[20:]):
            viewer.add(round_results.directory, part)
        viewer.renew(round_results.directory)
    recorded = Recorded(tmp_path / "live.rrd")
    body = recorded["/world/body", "Transform3D:translation"][:, 0]
    np.testing.assert_allclose(body, round_drive.positions, atol=1e-5)
    strips = recorded.columns["/world/estimate", "LineStrips3D:strips"]
    assert len(strips[-1][0]) == len(round_drive)
    used = recorded["/series/landmarks/used", "Scalars:scalars"][:, 0]
    np.testing.assert_array_equal(used, round_results.steps["used"])
    measured = round_results.steps["nis_dof"] > 0
    nis = recorded["/series/nis/each_step", "Scalars:scalars"][:, 0]
    np.testing.assert_allclose(nis, np.ones(measured.sum()))
    half_sizes = recorded["/world/position_covariance", "Ellipsoids3D:half_sizes"][-1, 0]
    np.testing.assert_allclose(np.sort(half_sizes), [1.5, 3.0, 6.0], rtol=1e-5)
    assert len(recorded.columns["/world/landmarks", "Points3D:positions"][-1]) == 3


def test_another_pass_has_a_path_of_its_own(round_results: Results, tmp_path: Path) -> None:
    pytest.importorskip("rerun.chunk", reason="the extra view is not installed")
    steps = GrowingResults(round_results.directory).new_steps()
    with opened_stream("live", tmp_path / "live.rrd") as stream:
        viewer = LiveViewer(stream)
        viewer.add(round_results.directory, steps)
        viewer.begin_pass()
        viewer.add(round_results.directory, steps[30:35])
        viewer.renew(round_results.directory)
    recorded = Recorded(tmp_path / "live.rrd")
    strips = recorded.columns["/world/estimate", "LineStrips3D:strips"]
    assert len(strips[-1][0]) == 5
    assert max(recorded.seconds["/world/body"][60:]) == pytest.approx(0.4)
