# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A listener as a process beside a graph."""

import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from reliability.load.graph import TOOLS
from reliability.load.latency import Messages, parse
from reliability.load.listener import READY
from vislam_ros.errors import VislamError

_WAIT = 60.0


class Listening:
    """A listener that is ready."""

    def __init__(self, process: "subprocess.Popen[str]"):
        self._process = process

    def end(self) -> Messages:
        """End it, and tell what it has heard."""
        said, _ = self._process.communicate(timeout=_WAIT)
        return parse(said.splitlines())


@contextmanager
def listening(environment: Mapping[str, str], *words: str) -> Iterator[Listening]:
    """Listen in an environment while the block runs.

    Parameters
    ----------
    environment : mapping
    words : str
        Arguments of the listener.

    Raises
    ------
    VislamError
        Where it does not start.
    """
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "reliability.load.listener", *words],
        env={**environment, "PYTHONPATH": str(TOOLS)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        if process.stdout.readline().strip() != READY:
            raise VislamError("the listener did not start")
        yield Listening(process)
    finally:
        process.kill()
        process.wait()
