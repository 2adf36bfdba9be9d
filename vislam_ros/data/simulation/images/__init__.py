# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stereo images of a street or a room, drawn along a motion that is known exactly."""
