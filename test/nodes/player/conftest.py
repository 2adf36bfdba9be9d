# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bag, a player of it and a listener."""

import threading
from contextlib import ExitStack

import pytest
from live.listening import STEPS, WAIT, Listener

from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.nodes.player.player import Player
from vislam_ros.nodes.spin import spinning


@pytest.fixture(scope="module")
def drive():
    return simulate(SimulationSettings(steps=STEPS, landmarks=150)).drive


@pytest.fixture(scope="module")
def bag_path(tmp_path_factory, drive):
    path = tmp_path_factory.mktemp("player") / "bag"
    write_bag(drive, path)
    return path


@pytest.fixture
def bag(bag_path):
    with BagMessages(bag_path) as bag:
        yield bag


@pytest.fixture
def listen(context):
    """Make a listener that a thread spins."""
    with ExitStack() as listeners:

        def start(**options):
            node = Listener(context, **options)
            listeners.callback(node.destroy_node)
            listeners.enter_context(spinning(node))
            return node

        yield start


@pytest.fixture
def make_player(context, bag):
    players = []

    def make(options, source=bag):
        node = Player(source, options, context)
        players.append(node)
        return node

    yield make
    for node in players:
        node.destroy_node()


@pytest.fixture
def play_in_thread():
    """Start a player; the test interrupts it or waits for its report."""
    started = []

    def start(node):
        reports = []
        thread = threading.Thread(target=lambda: reports.append(node.play()))
        thread.start()
        started.append((node, thread))

        def report():
            thread.join(WAIT)
            assert not thread.is_alive(), "the player did not end"
            return reports[0]

        return report

    yield start
    for node, thread in started:
        node.clock.interrupt()
        thread.join(WAIT)
