# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Results in the Rerun viewer, or in a file for it."""
