# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes, each ended by its own pid, and how to wait for what they should do."""

import os
import subprocess
import sys
import time
from collections.abc import Callable

from places import REPOSITORY
from rclpy.executors import SingleThreadedExecutor

WAIT = 40.0


class Processes:
    """Starts nodes and ends each by its own pid."""

    def __init__(self, domain_id: int):
        self._environment = dict(os.environ, ROS_DOMAIN_ID=str(domain_id))
        self._started: list[subprocess.Popen[str]] = []

    def start(self, module: str, *arguments: str) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [sys.executable, "-m", f"vislam_ros.{module}", *arguments],
            cwd=REPOSITORY,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._started.append(process)
        return process

    def run_to_end(self, module: str, *arguments: str) -> "tuple[int, list[str]]":
        process = self.start(module, *arguments)
        _, errors = process.communicate(timeout=WAIT)
        return process.returncode, errors.splitlines()

    def end_all(self) -> None:
        for process in self._started:
            process.kill()
            process.communicate(timeout=WAIT)


def wait_until(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen"
        time.sleep(0.02)


def spin_until(
    executor: SingleThreadedExecutor, condition: Callable[[], object], what: str
) -> None:
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen"
        executor.spin_once(timeout_sec=0.05)
