# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A file for each command."""
