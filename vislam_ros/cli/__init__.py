# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line: one parser, and a function for each command."""
