# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A ``vislam run`` as a process, and its children."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from places import REPOSITORY

WAIT = 60.0


class Run:
    """A ``vislam run`` whose children can be told from all other processes by its directory."""

    def __init__(self, data: Path, out: Path, *flags: str, **options: Any):
        unwanted = (
            ("ROS_DOMAIN_ID",) if options.pop("measured", True) else ("ROS_DOMAIN_ID", "COV")
        )
        environment = {k: v for k, v in os.environ.items() if not k.startswith(unwanted)}
        environment.update(options.pop("environment", {}))
        if not options.pop("pictures", False):  # they are two seconds of work
            flags = (*flags, "--no-pictures")
        self.out = out
        self.process = subprocess.Popen(
            [sys.executable, "-m", "vislam_ros.cli.main", "run", data, "--out", out, *flags],
            cwd=REPOSITORY,
            env={**environment, "VISLAM_TEST_RUN": str(out)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )

    def pids(self) -> dict[str, int]:
        """The processes of this run that are alive, by what they run."""
        mark = f"VISLAM_TEST_RUN={self.out}\0".encode()
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):  # it may end while we look
                if mark in (folder / "environ").read_bytes():
                    words = (folder / "cmdline").read_bytes().decode().split("\0")
                    modules = [word for word in words if word.startswith("vislam_ros.")]
                    found[modules[-1] if modules else "?"] = int(folder.name)
        return found

    def summary(self) -> dict[str, Any]:
        try:
            return dict(json.loads((self.out / "summary.json").read_text()))
        except FileNotFoundError:
            return {}

    def is_stopped(self, module: str) -> bool:
        """Whether a process of this run stands still after a signal."""
        stat = Path(f"/proc/{self.pids()[module]}/stat").read_text()
        return stat.rpartition(")")[2].split()[0] == "T"

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not happen"
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.02)

    def wait_for_steps(self) -> None:
        self.wait_until(lambda: self.summary().get("steps", 0) > 5, "the first steps")

    def end(self) -> tuple[int, str, list[str]]:
        output, errors = self.process.communicate(timeout=WAIT)
        return self.process.returncode, output, errors.splitlines()

    def assert_nothing_is_left(self) -> None:
        deadline = time.monotonic() + WAIT
        while self.pids():
            assert time.monotonic() < deadline, f"still alive: {self.pids()}"
            time.sleep(0.02)
