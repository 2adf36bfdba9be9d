# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the live graph takes: rates, latencies, memory over time, and a network that breaks."""
