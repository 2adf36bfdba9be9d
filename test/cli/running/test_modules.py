# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a process of a run imports is what it needs: the others wait for it at the start."""

import json
import subprocess
import sys

import pytest

from vislam_ros.cli.running.modules import NODES, PREPARED

SLOW = {"cv2", "matplotlib", "numba", "plotly", "rerun", "scipy"}
NEEDED = {
    "vislam_ros.cli.running.session": set(),
    "vislam_ros.nodes.imu_prediction_node": set(),
    "vislam_ros.nodes.recorder_node": set(),
    "vislam_ros.cli.commands.play": set(),
    "vislam_ros.nodes.slam_node": {"numba", "scipy"},
}


@pytest.mark.parametrize(("module", "needed"), NEEDED.items())
def test_no_process_imports_what_is_slow_and_not_its_own(module, needed):
    program = f"import json, sys, {module}\nprint(json.dumps(list(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    loaded = set(json.loads(result.stdout))
    assert loaded & SLOW == needed
    assert ("rclpy" in loaded) == (module != "vislam_ros.cli.running.session")


def test_all_nodes_of_a_run_and_its_player_are_prepared():
    assert set(PREPARED) == {*NODES, "player"}
