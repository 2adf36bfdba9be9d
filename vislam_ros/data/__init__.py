# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Datasets, bags, trajectories, results, simulation and evaluation: files, and no rclpy."""
