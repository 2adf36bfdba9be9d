# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a drive costs when messages are missing or wrong."""
