# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses, cameras and how image points move."""
