# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Message types that no package brings, made at run time."""
