# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""EKF visual-inertial SLAM from stereo feature tracks and IMU twist, replayed live on ROS 2.

Four layers, and an import only ever points down: :mod:`vislam_ros.core` (mathematics),
:mod:`vislam_ros.data` (datasets, bags, results), :mod:`vislam_ros.nodes` (rclpy) and
:mod:`vislam_ros.cli` (the command line).
"""

__version__ = "0.1.0"
