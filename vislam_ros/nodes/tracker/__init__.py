# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stereo_tracker_node makes of its streams: pairs, their turns, their cameras."""
