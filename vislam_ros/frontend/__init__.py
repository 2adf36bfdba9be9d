# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From stereo images to tracks of points: no ROS, no files."""
