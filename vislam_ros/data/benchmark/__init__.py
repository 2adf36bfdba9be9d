# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How fast the filters are, beside the floor under them and beside their peers."""
