# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the front end costs, stage by stage, and how good its tracks are."""
