# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The two quality-of-service profiles of the graph.

KEEP_LAST loses messages whenever a publisher outruns its subscriber, reliable or not; KEEP_ALL
makes the publisher wait.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

STREAM = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)

LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
