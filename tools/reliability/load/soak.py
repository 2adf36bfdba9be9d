# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The graph at full rate for long: memory of its processes, and whether all passes are equal."""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from reliability.load.graph import START_SECONDS, Graph, local_environment, running_graph
from reliability.load.processes import growth, resident_mb
from vislam_ros.data.results.summary import read_summary
from vislam_ros.data.results.writer import pass_directory
from vislam_ros.errors import VislamError

LARGEST_GROWTH = 1.0
"""MB in ten minutes."""


@dataclass
class Soak:
    """What a soak has seen so far.

    Attributes
    ----------
    warm_up : float
        Seconds that do not count for the growth.
    seconds : list of float
        When memory was read, since the first pose.
    megabytes : dict of str to list of float
        Memory of each process by then.
    passes, same : int
        Passes that ended whole, and those of them with the trajectory of the offline estimate.
    broken : list of str
        What is wrong with other passes that have ended.
    """

    warm_up: float
    seconds: list[float] = field(default_factory=list)
    megabytes: dict[str, list[float]] = field(default_factory=dict)
    passes: int = 0
    same: int = 0
    broken: list[str] = field(default_factory=list)

    def growth(self, name: str) -> float:
        """MB in ten minutes of a process after the warm-up."""
        return growth(self.seconds, self.megabytes[name], self.warm_up)

    @property
    def holds(self) -> bool:
        """Whether memory is flat and each pass whole and the same."""
        flat = all(self.growth(name) < LARGEST_GROWTH for name in self.megabytes)
        return flat and not self.broken and self.same == self.passes > 0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "warm_up_s": self.warm_up,
            "passes": self.passes,
            "same": self.same,
            "broken": self.broken,
            "growth_mb_in_10_min": {name: self.growth(name) for name in self.megabytes},
            "seconds": self.seconds,
            "megabytes": self.megabytes,
            "holds": self.holds,
        }


def soak(
    bag: Path,
    offline: bytes,
    out: Path,
    warm_up: float,
    goes_on: Callable[[Soak], bool],
) -> Soak:
    """Loop a bag at full rate, read the memory of all processes each second, while it goes on."""
    seen = Soak(warm_up)
    with local_environment() as environment, running_graph(out, environment) as graph:
        graph.play(bag, "--rate=0", "--loop")
        graph.wait(lambda: graph.poses() > 0, 2 * START_SECONDS, "the first pose")
        seen.megabytes = {name: [] for name in graph.processes}
        began = time.monotonic()
        for second in itertools.count():
            _read_memory(graph, seen, time.monotonic() - began)
            _check_passes(out, offline, seen)
            if not goes_on(seen):
                break
            left = began + second + 1 - time.monotonic()
            graph.has_come(lambda: False, max(0.0, left))
    return seen


def _read_memory(graph: Graph, seen: Soak, now: float) -> None:
    seen.seconds.append(now)
    for name, process in graph.processes.items():
        seen.megabytes[name].append(resident_mb(process.pid))


def _check_passes(out: Path, offline: bytes, seen: Soak) -> None:
    """Compare each pass that has ended and was not compared yet."""
    for number in itertools.count(seen.passes + len(seen.broken) + 1):
        directory = pass_directory(out, number)
        # The recorder completes a pass only when the next one has begun.
        if not pass_directory(out, number + 1).is_dir():
            return
        try:
            summary = read_summary(directory / "summary.json")
        except VislamError:
            return
        if not summary["complete"]:
            if not pass_directory(out, number + 2).is_dir():
                return
            seen.broken.append(f"pass {number}: {summary['incomplete_reason']}")
            continue
        seen.passes += 1
        seen.same += (directory / "trajectory.tum").read_bytes() == offline
        (directory / "results.mcap").unlink(missing_ok=True)  # half an hour fills a disk
