# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A network that breaks and heals between nodes in namespaces of their own."""

import dataclasses
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from reliability.load.network import Network, network
from reliability.load.offline import offline_trajectory
from reliability.load.partition import (
    MEMBERS,
    Partition,
    PartitionRow,
    measure_partition,
    partitions,
)

from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.errors import VislamError

ROW = PartitionRow(
    partition=Partition("player", 1.0, 1.0, 0.3),
    poses=90,
    expected=100,
    same=False,
    complete=False,
    reason="10 of 100 steps did not arrive",
    seconds=3.0,
    at_break=30,
    at_healing=31,
)


def test_a_gap_is_named_by_the_number_of_poses_that_are_missing() -> None:
    assert ROW.outcome == "named"
    assert dataclasses.replace(ROW, poses=91).outcome == "silent"
    assert dataclasses.replace(ROW, complete=True).outcome == "silent"
    assert dataclasses.replace(ROW, complete=True, same=True).outcome == "whole"
    assert dataclasses.replace(ROW, poses=100, same=True, reason="").outcome == "silent"


def test_each_link_breaks_for_each_time_at_each_rate_and_moment() -> None:
    planned = partitions(MEMBERS, [1.0, 3.0], [0.0, 1.0], [0.3, 0.9])
    assert len(planned) == len(set(planned)) == len(MEMBERS) * 8


@pytest.fixture
def built() -> Iterator[Network]:
    try:
        with network(MEMBERS) as built:
            yield built
    except VislamError as error:
        pytest.skip(f"needs network namespaces: {error}")


def test_a_run_is_whole_though_the_link_of_the_recorder_broke_when_the_player_ended(
    built: Network, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    write_bag(simulate(SimulationSettings(steps=40, landmarks=300)).drive, bag)
    offline = offline_trajectory(bag, tmp_path / "offline")
    partition = Partition("recorder_node", 3.0, 2.0, 0.25)
    row = measure_partition(built, bag, offline, tmp_path / "run", partition)
    assert row.at_healing < row.expected
    assert row.outcome == "whole"


def test_nothing_is_left_of_a_network() -> None:
    def names() -> str:
        return subprocess.run(
            ["ip", "netns", "list"], check=True, capture_output=True, text=True
        ).stdout

    try:
        with network(["player"]) as built:
            assert built.namespaces["player"] in names()
    except (VislamError, FileNotFoundError) as error:
        pytest.skip(f"needs network namespaces: {error}")
    assert built.namespaces["player"] not in names()
