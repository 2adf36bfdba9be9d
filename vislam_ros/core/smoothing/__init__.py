# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Going back over a drive: the exact map and smoothed poses."""
