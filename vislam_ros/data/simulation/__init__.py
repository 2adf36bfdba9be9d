# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives with exact ground truth."""
