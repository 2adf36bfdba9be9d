# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a filter does to its error state: propagate, correct, initialize, marginalize."""
