# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A bag through the graph with a listener beside it."""

import math
import time
from dataclasses import dataclass
from pathlib import Path

from reliability.load.graph import START_SECONDS, Graph, local_environment, running_graph
from reliability.load.latency import Messages
from reliability.load.listening import listening
from reliability.load.processes import cpu_seconds, cpu_shares

_WAIT = 60.0
# Of the first frames the nodes have work to do that they never have again.
_SETTLED_POSES = 5


@dataclass(frozen=True)
class Played:
    """What was heard of a play, and what it cost.

    Attributes
    ----------
    messages : Messages
    cpu : dict of str to float
        Share of a core that each process took from the first poses until the player ended.
    """

    messages: Messages
    cpu: dict[str, float]


def play_heard(bag: Path, out: Path, rate: float, duration: float = math.inf) -> Played:
    """Play a bag, or some of its seconds, and wait until all frames are answered."""
    with (
        local_environment() as environment,
        running_graph(out, environment) as graph,
        listening(environment) as listener,
    ):
        part = [] if math.isinf(duration) else [f"--duration={duration:g}"]
        # The node that each is for, and the listener.
        player = graph.play(bag, f"--rate={rate:g}", "--subscribers=2", *part)
        graph.wait(lambda: graph.poses() >= _SETTLED_POSES, 2 * START_SECONDS, "poses")
        began, before = time.monotonic(), _cpu(graph)
        after, ended = before, began
        while player.exit_code is None:
            after, ended = _cpu(graph), time.monotonic()
            graph.has_come(lambda: player.exit_code is not None, 0.2)
        graph.has_come(graph.is_settled, _WAIT)
        messages = listener.end()
    return Played(messages, cpu_shares(before, after, ended - began))


def _cpu(graph: Graph) -> dict[str, float]:
    return {name: cpu_seconds(process.pid) for name, process in graph.processes.items()}
