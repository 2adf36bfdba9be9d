# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The rclpy nodes: a callback turns a message into arrays, calls the core, answers in messages."""
