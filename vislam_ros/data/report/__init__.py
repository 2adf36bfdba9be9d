# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A result directory as one HTML page that needs nothing else."""
