# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The nodes and the player as processes, as ``vislam run`` starts them, for those who measure."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from vislam_ros.cli.domain import local_graph, own_domain
from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.parameters import shared_file
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.running.modules import NODES
from vislam_ros.data.results.summary import has_ended, read_summary
from vislam_ros.errors import VislamError

START_SECONDS = 60.0
"""How long the nodes may take to start and to find each other."""

TOOLS = Path(__file__).resolve().parents[2]
_IN_NAMESPACE = "reliability.load.in_namespace"
_POLL_SECONDS = 0.02


class Graph:
    """The nodes of a run, which record into a directory.

    Parameters
    ----------
    results : Path
        Result directory; logs go to its folder ``log``.
    environment : mapping
        Of the processes; see :func:`local_environment`.
    namespaces : mapping of str to str, optional
        Network namespace of each node and of the player.
    """

    def __init__(
        self,
        results: Path,
        environment: Mapping[str, str],
        namespaces: Mapping[str, str] | None = None,
    ):
        self.results = results
        self._namespaces = namespaces or {}
        log = results / "log"
        log.mkdir(parents=True)
        logs = {"ROS_LOG_DIR": str(log / "ros"), "PYTHONPATH": str(TOOLS)}
        self._children = Children({**environment, **logs}, log)
        self.processes: dict[str, Child] = {}
        parameters = shared_file("ekf.yaml")
        told = ["--ros-args", *(["--params-file", str(parameters)] if parameters else [])]
        for node in NODES:
            own = ["-p", f"directory:={results}", "-p", "force:=true"]
            self._start(
                node,
                f"vislam_ros.nodes.{node}",
                [*told, *(own if node == "recorder_node" else [])],
            )

    def _start(self, name: str, module: str, arguments: Sequence[str]) -> Child:
        if name in self._namespaces:
            arguments = [self._namespaces[name], module, *arguments]
            module = _IN_NAMESPACE
        self.processes[name] = self._children.start(name, module, arguments)
        return self.processes[name]

    def play(self, bag: Path, *arguments: str) -> Child:
        """Start the player, which waits until the whole graph is there."""
        told = ["play", str(bag), "--whole-graph", f"--wait={START_SECONDS:g}", *arguments]
        return self._start("player", "vislam_ros.cli.main", told)

    def wait(self, is_so: Callable[[], bool], seconds: float, what: str) -> None:
        """Wait for a condition.

        Raises
        ------
        VislamError
            Where a process ends before its time, or the condition does not hold in time.
        """
        if not self.has_come(is_so, seconds):
            raise VislamError(f"{what} did not come in {seconds:g} s: see {self.results / 'log'}")

    def has_come(self, is_so: Callable[[], bool], seconds: float) -> bool:
        """Wait for a condition; tell whether it holds in time."""
        end = time.monotonic() + seconds
        while not is_so():
            for name, process in self.processes.items():
                if process.exit_code is not None and (name != "player" or process.exit_code != OK):
                    raise process.died()
            if time.monotonic() > end:
                return False
            time.sleep(_POLL_SECONDS)
        return True

    def poses(self) -> int:
        """How many poses the recorder has written."""
        try:
            return (self.results / "trajectory.tum").read_bytes().count(b"\n")
        except OSError:
            return 0

    def summary(self) -> dict[str, Any]:
        """What the recorder says of the run as it stands; empty before it says anything."""
        with suppress(VislamError):
            return read_summary(self.results / "summary.json")
        return {}

    def is_settled(self) -> bool:
        """Whether the recorder has said how the run ended."""
        summary = self.summary()
        return bool(summary) and has_ended(summary)

    def end(self) -> None:
        """End all processes, the recorder last."""
        self._children.end(writer=self.processes.get("recorder_node"))


@contextmanager
def running_graph(
    results: Path,
    environment: Mapping[str, str],
    namespaces: Mapping[str, str] | None = None,
) -> Iterator[Graph]:
    """Start the nodes, and end them and the player after the block."""
    graph = Graph(results, environment, namespaces)
    try:
        yield graph
    finally:
        graph.end()


@contextmanager
def local_environment() -> Iterator[dict[str, str]]:
    """Environment of processes that meet on this machine and on a domain of their own."""
    with own_domain() as domain:
        yield {**os.environ, **local_graph(), "ROS_DOMAIN_ID": str(domain)}
