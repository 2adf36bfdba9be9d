# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The grammar of each command: its flags, what they take, and their help."""
