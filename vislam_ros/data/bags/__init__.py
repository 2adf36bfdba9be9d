# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""MCAP bags: messages, their layout, reading and writing."""
