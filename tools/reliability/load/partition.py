# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A link that breaks during a run and heals: whether the result is whole, to the byte."""

import itertools
import re
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from reliability.load.graph import START_SECONDS, running_graph
from reliability.load.network import Network
from vislam_ros.cli.running.modules import NODES

MEMBERS = (*NODES, "player")

SETTLING_SECONDS = 60.0
"""How long after the drive and the partition a run may take to say how it ended."""


@dataclass(frozen=True)
class Partition:
    """A link that is down for some time.

    Attributes
    ----------
    member : str
        Whose link it is, one of :data:`MEMBERS`.
    seconds : float
    rate : float
        Of the player.
    moment : float
        Share of the poses that are recorded when it breaks.
    """

    member: str
    seconds: float
    rate: float
    moment: float


@dataclass(frozen=True)
class PartitionRow:
    """What came of it.

    Attributes
    ----------
    partition : Partition
    poses : int
        Poses in ``trajectory.tum``.
    expected : int
        Those of the offline estimate.
    same : bool
        Whether both files have the same bytes.
    complete : bool
    reason : str
        Why it is not, as ``summary.json`` says; empty where it says nothing.
    seconds : float
        From the break until the run ended.
    at_break, at_healing : int
        Poses that were recorded by then.
    """

    partition: Partition
    poses: int
    expected: int
    same: bool
    complete: bool
    reason: str
    seconds: float
    at_break: int
    at_healing: int

    @property
    def names_gap(self) -> bool:
        """Whether a number in the reason is that of the missing poses."""
        missing = self.expected - self.poses
        return not self.complete and str(missing) in re.findall(r"\d+", self.reason)

    @property
    def outcome(self) -> str:
        """One of whole, named and silent."""
        if self.complete and self.same:
            return "whole"
        return "named" if self.names_gap else "silent"

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {**asdict(self), "outcome": self.outcome}


def partitions(
    members: Sequence[str],
    seconds: Sequence[float],
    rates: Sequence[float],
    moments: Sequence[float],
) -> list[Partition]:
    """Each link, length, rate and moment with each other."""
    return [
        Partition(member, length, rate, moment)
        for rate, length, moment, member in itertools.product(rates, seconds, moments, members)
    ]


def measure_partition(
    network: Network, bag: Path, offline: bytes, out: Path, partition: Partition
) -> PartitionRow:
    """Run a bag whose offline trajectory is known, and break a link meanwhile."""
    expected = offline.count(b"\n")
    at_last = round(partition.moment * expected)
    with running_graph(out, network.environment, network.namespaces) as graph:
        graph.play(bag, f"--rate={partition.rate:g}")
        graph.wait(lambda: graph.poses() >= max(1, at_last), 2 * START_SECONDS, "the moment")
        network.cut(partition.member)
        cut_at, at_break = time.monotonic(), graph.poses()
        try:
            graph.has_come(lambda: False, partition.seconds)
        finally:
            at_healing = graph.poses()
            network.heal(partition.member)
        graph.has_come(graph.is_settled, SETTLING_SECONDS)
        seconds = time.monotonic() - cut_at
        summary = graph.summary()
    recorded = (out / "trajectory.tum").read_bytes()
    return PartitionRow(
        partition=partition,
        poses=recorded.count(b"\n"),
        expected=expected,
        same=recorded == offline,
        complete=bool(summary.get("complete")),
        reason=str(summary.get("incomplete_reason") or ""),
        seconds=seconds,
        at_break=at_break,
        at_healing=at_healing,
    )
