# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A process that ends or stands still is seen from the first moment on, whoever is busy."""

import os
import signal
import time
from contextlib import closing

import pytest
from places import REPOSITORY

from vislam_ros.cli.processes import prepared_children
from vislam_ros.cli.running.watch import Watch
from vislam_ros.errors import VislamError

WAIT = 30.0


@pytest.fixture
def children(tmp_path, monkeypatch):
    """Prepare a node and the player, which do nothing until they are told to."""
    monkeypatch.setenv("PYTHONPATH", f"{REPOSITORY}:{tmp_path}")
    (tmp_path / "idle.py").write_text("def main():\n    return 0\n")
    with prepared_children({"node": ("idle",), "player": ("idle",)}) as prepared:
        yield prepared


def error_of(watch):
    deadline = time.monotonic() + WAIT
    while time.monotonic() < deadline:
        try:
            watch.check()
        except VislamError as error:
            return str(error)
        time.sleep(0.02)
    raise AssertionError("nothing was seen")


def test_a_child_that_is_killed_before_it_begins_is_named(children):
    with closing(Watch(children.values())) as watch:
        watch.check()
        children["node"].send(signal.SIGKILL)
        assert error_of(watch).startswith("node ended early with signal 9 (SIGKILL)")


def test_a_child_that_stands_still_is_named_and_one_that_goes_on_again_is_not(children):
    with closing(Watch(children.values())) as watch:
        for number in (signal.SIGSTOP, signal.SIGCONT):
            children["player"].send(number)
            time.sleep(0.1)
        children["node"].send(signal.SIGSTOP)
        assert error_of(watch) == "node was stopped by a signal and did not go on"


def test_a_player_may_end_when_it_has_played_all_and_a_node_may_not(children, tmp_path):
    with closing(Watch(children.values())) as watch:
        for name in ("player", "node"):
            watch.check()
            children[name].begin([], os.environ, tmp_path)
            assert children[name].wait(WAIT)
        assert error_of(watch) == (
            f"node ended early with exit code 0: it was told to end ({tmp_path}/node.log)"
        )
