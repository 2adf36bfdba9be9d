# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A player at full speed, and a node that is busy for longer than it takes to lose patience."""

import signal
from dataclasses import replace

import pytest
from live.listening import FULL_SPEED, STEPS, wait_until

from vislam_ros.data.bags.layout import FEATURES, ODOMETRY, TWIST
from vislam_ros.nodes.player import graph, player

WINDOW = 4


@pytest.mark.alone
def test_a_node_that_is_busy_is_waited_for_and_not_flooded(
    processes, listen, make_player, play_in_thread, monkeypatch
):
    monkeypatch.setattr(player, "STALL_SECONDS", 2.0)
    monkeypatch.setattr(graph, "_SILENCE_SECONDS", 0.3)
    processes.start("nodes.imu_prediction_node")
    slam_node = processes.start("nodes.slam_node")
    listener = listen(topics=[FEATURES, TWIST, ODOMETRY])
    features, poses = (listener.heard[topic.recorded] for topic in (FEATURES, ODOMETRY))
    wait_until(lambda: listener.count_publishers(ODOMETRY.name), "the start of slam_node")
    # The listener and a node of each stream: one that is not found yet would miss the beginning.
    playing = make_player(replace(FULL_SPEED, window=WINDOW, passes=2, subscribers=2))
    wait_until(lambda: playing.count_publishers(ODOMETRY.name), "the player's sight of slam_node")
    report = play_in_thread(playing)
    wait_until(lambda: len(poses) > 5, "the first poses")
    slam_node.send_signal(signal.SIGSTOP)
    told = len(listener.states)
    wait_until(lambda: len(listener.states) > told + 4, "the player's reports of four seconds")
    assert len(features) <= len(poses) + WINDOW + 1
    slam_node.send_signal(signal.SIGCONT)
    assert report().state == "finished"
    wait_until(lambda: len(poses) == 2 * STEPS, "a pose for each frame of both passes")
