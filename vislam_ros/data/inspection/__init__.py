# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What data are, and what is wrong with them."""
