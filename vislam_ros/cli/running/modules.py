# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a run starts as processes, as soon as it is known that there is one."""

from collections.abc import Mapping, Sequence

NODES = ("imu_prediction_node", "slam_node", "recorder_node")
"""The nodes of every run, the recorder last."""
PLAYER = "player"

#: Module and first arguments, by name. The slowest to import comes first.
PREPARED: Mapping[str, Sequence[str]] = {
    **{
        name: (f"vislam_ros.nodes.{name}",)
        for name in ("slam_node", "recorder_node", "imu_prediction_node")
    },
    PLAYER: ("vislam_ros.cli.main", "play"),
}
