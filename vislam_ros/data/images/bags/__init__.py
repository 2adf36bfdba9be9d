# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags with images."""
