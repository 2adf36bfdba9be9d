# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a drive tells of its own noise."""
