# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What measures the project: speed, accuracy, consistency, peers."""
