# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files and directories that are whole or not there."""
