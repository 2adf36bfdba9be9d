# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stamps, tracks and frames: what a step is fed with."""
