# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the recorder asks of the other nodes, and how it ends."""
