# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A live run: the graph as processes, what they record, and its end."""
