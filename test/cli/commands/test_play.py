# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The player as a process of its own: how it ends, and what it says."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from signal import Signals
from subprocess import Popen
from typing import Any

import pytest
from places import REPOSITORY

from vislam_ros.cli.domain import own_domain

WAIT = 60.0


@pytest.fixture
def start(bag: Path) -> Iterator[Callable[..., Any]]:
    """Start a player in a domain of its own."""
    with own_domain() as domain:
        started = []

        def start(*flags: str) -> Popen[Any]:
            environment = {
                **os.environ,
                "ROS_DOMAIN_ID": str(domain),
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            }
            process = subprocess.Popen(
                [sys.executable, REPOSITORY / "tools" / "play_bag.py", bag, *flags],
                cwd=REPOSITORY,
                env={**environment, "PYTHONPATH": str(REPOSITORY)},
                stderr=subprocess.PIPE,
                text=True,
            )
            started.append(process)
            return process

        yield start
        for process in started:
            process.kill()
            process.communicate(timeout=WAIT)


def test_it_plays_without_anybody_and_says_so(start: Callable[..., Any]) -> None:
    process = start("--rate", "0", "--wait", "0.2")
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 0, errors
    assert "without 1 subscriber(s) of imu/twist, 1 subscriber(s) of stereo/features" in errors
    last = errors.splitlines()[-1]
    assert last.startswith("finished: ")
    assert last.endswith(", and nobody listened")


def test_it_takes_the_arguments_of_ros_as_every_node_does(start: Callable[..., Any]) -> None:
    process = start(
        *("--rate", "0", "--wait", "0", "--namespace", "one"),
        *("--ros-args", "-r", "__node:=source", "-p", "no_such:=1"),
    )
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 0, errors
    assert "[one.source]: no_such: no such parameter, it has no effect" in errors


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--no-such-argument",), "no such ROS arguments: ['--no-such-argument']"),
        (("-p", "use_sim_time:=7"), "use_sim_time"),
        (("-p", "qos_overrides./imu/twist.publisher.reliability:=sometimes"), "/imu/twist"),
    ],
)
def test_arguments_of_ros_that_will_not_do_are_told_in_one_line(
    start: Callable[..., Any], arguments: tuple[str, ...], words: str
) -> None:
    process = start("--topics", "/imu/twist", "--ros-args", *arguments)
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 1
    (line,) = errors.splitlines()
    assert line.startswith("error: ")
    assert words in line


@pytest.mark.parametrize(
    ("flags", "words", "code"),
    [
        (
            ("--remap", "/imu/twist:=/stereo/features"),
            "/stereo/features: is sensor_msgs/msg/PointCloud2 and cannot be played as /stereo",
            1,
        ),
        (
            ("--remap", "/imu/twist:=a//b"),
            "error: /imu/twist: cannot be played as a//b: ",
            1,
        ),
        (
            ("--remap", "/imu/twist:=/diagnostics"),
            "and cannot be played as /diagnostics, which is diagnostic_msgs/msg/DiagnosticArray: ",
            1,
        ),
        (("--remap", "__node:=a/b"), "error: Failed to parse ROS arguments: ", 1),
        (("--rate", "1e300"), "argument --rate: 1e300 is not from 0 to 1e+06", 2),
        (("--start-offset", "1e300"), "argument --start-offset: 1e300 is not from 0 to", 2),
    ],
)
def test_wrong_usage_is_told_in_one_line(
    start: Callable[..., Any], flags: tuple[str, ...], words: str, code: int
) -> None:
    process = start("--wait", "0", *flags)
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == code, errors
    assert words in errors.splitlines()[-1]
    if code == 1:
        assert len(errors.splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("flags", "begins"),
    [
        (("--wait", "1000"), "waiting up to 1000 s for 1 subscriber(s) of imu/twist"),
        (("--wait", "0.1", "--loop", "--rate", "0.5"), "playing after 0.1 s without"),
    ],
)
def test_a_signal_ends_it_at_once_and_without_a_traceback(
    start: Callable[..., Any], number: Signals, flags: tuple[str, ...], begins: str
) -> None:
    process = start(*flags)
    watchdog = threading.Timer(WAIT, process.kill)
    watchdog.start()
    assert any(begins in line for line in process.stderr)
    watchdog.cancel()
    process.send_signal(number)
    _, errors = process.communicate(timeout=WAIT)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith("interrupted: ")
