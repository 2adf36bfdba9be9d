# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many solutions of a drive, in parallel."""
