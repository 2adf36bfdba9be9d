# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the estimate owes to each constant: varied one at a time, over many drives."""
