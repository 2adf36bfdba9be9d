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


@pytest.fixture(autouse=True)
def interruptible():
    """SIGTERM interrupts the test, as it does a command."""

    def interrupt(_signal, _frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    yield
    signal.signal(signal.SIGTERM, before)


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


def test_who_is_busy_is_interrupted_until_it_looks_by_itself(children):
    with closing(Watch(children.values())) as watch:
        children["node"].send(signal.SIGKILL)
        with pytest.raises(KeyboardInterrupt):
            time.sleep(WAIT)
        with pytest.raises(VislamError, match="node ended early"):
            watch.check()


def test_a_child_that_is_killed_before_it_begins_is_named(children):
    with closing(Watch(children.values())) as watch:
        watch.settle()
        children["node"].send(signal.SIGKILL)
        assert error_of(watch).startswith("node ended early with signal 9 (SIGKILL)")


def test_a_child_that_stands_still_is_named_and_one_that_goes_on_again_is_not(children):
    with closing(Watch(children.values())) as watch:
        watch.settle()
        for number in (signal.SIGSTOP, signal.SIGCONT):
            children["player"].send(number)
            time.sleep(0.1)
        children["node"].send(signal.SIGSTOP)
        assert error_of(watch) == "node was stopped by a signal and did not go on"


def test_a_player_may_end_when_it_has_played_all_and_a_node_may_not(children, tmp_path):
    with closing(Watch(children.values())) as watch:
        watch.settle()
        for name in ("player", "node"):
            watch.check()
            children[name].begin([], os.environ, tmp_path)
            assert children[name].wait(WAIT)
        assert error_of(watch) == (
            f"node ended early with exit code 0: it was told to end ({tmp_path}/node.log)"
        )
