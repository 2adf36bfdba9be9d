# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the step alone takes at a drive's pace: the part of a latency that no message can spare.

A process that waits for a tenth of a second finds the caches filled by others, its core asleep.
"""

import time

import numpy as np
import threadpoolctl

from reliability.load.latency import Percentiles
from vislam_ros.core.filters.dead_reckoning import DeadReckoning
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.data.drive import Drive
from vislam_ros.data.solving import feed
from vislam_ros.data.trajectory import NANOSECONDS

# As slam_node does.
_THREADS = 1


def paced_steps(drive: Drive, seconds: float) -> dict[str, Percentiles]:
    """Milliseconds of a step in this process, without ROS, by how soon one follows another.

    Parameters
    ----------
    drive : Drive
    seconds : float
        Of the drive.
    """
    begin = drive.feature_stamps[0]
    part = drive.with_frames(drive.feature_stamps - begin < seconds * NANOSECONDS)
    with threadpoolctl.threadpool_limits(_THREADS):
        return {
            "a step without ROS, one after the other": _steps(part, paced=False),
            "a step without ROS, at the drive's pace": _steps(part, paced=True),
        }


def _steps(drive: Drive, *, paced: bool) -> Percentiles:
    slam, milliseconds = Slam(SlamSettings()), []
    slam.set_camera(drive.camera)
    first, began = int(drive.feature_stamps[0]), time.monotonic()
    for _, steps in feed(drive, DeadReckoning(PredictionSettings()), slam):
        milliseconds += [step.ms for step in steps]
        if paced and steps:
            due = began + (steps[-1].stamp - first) / NANOSECONDS
            time.sleep(max(due - time.monotonic(), 0.0))
    return Percentiles.of(np.array(milliseconds))
