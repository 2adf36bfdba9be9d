# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stereo images from files and bags, one pair after the other, and the tracks made of them."""
