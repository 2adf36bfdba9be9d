# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Judging and drawing what was estimated."""
