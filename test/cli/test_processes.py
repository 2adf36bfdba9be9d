# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Children end when they are told to, and never outlive their parent."""

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from places import REPOSITORY

from vislam_ros.cli import processes
from vislam_ros.cli.domain import own_domain
from vislam_ros.cli.exit_codes import INTERRUPTED
from vislam_ros.cli.processes import Child, Children
from vislam_ros.errors import VislamError

WAIT = 30.0

POLITE = """\
import time
print("ready", flush=True)
try:
    time.sleep(1000)
except KeyboardInterrupt:
    print("good-bye", time.monotonic_ns(), flush=True)
"""
WRITER = """\
import signal, sys, time
def end(*_):
    print("good-bye", time.monotonic_ns(), flush=True)
    sys.exit()
signal.signal(signal.SIGUSR1, end)
print("ready", flush=True)
time.sleep(1000)
"""
DEAF = """\
import signal, time
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
    signal.signal(number, signal.SIG_IGN)
print("ready", flush=True)
time.sleep(1000)
"""
SLOW_TO_START = """\
import time
print("ready", flush=True)
time.sleep(1000)
"""
FAILING = """\
import sys
print("about to fail")
sys.exit("error: the disk is full")
"""
TOLD = """\
import os, sys
print("imported", flush=True)
def prepare(words):
    print("prepared for", *words, flush=True)
def main():
    print("told", *sys.argv[1:], os.environ["MOOD"], flush=True)
    return 3
"""
PARENT = """\
import os, sys, time
from pathlib import Path
from vislam_ros.cli.processes import Child
child = Child("child", sys.argv[1], [], os.environ, Path(sys.argv[2]))
print(child.pid, flush=True)
time.sleep(1000)
"""

PREPARING_PARENT = """\
import time
from vislam_ros.cli.processes import prepared_children
with prepared_children({"ready": ("ready_module",)}) as prepared:
    print(prepared["ready"].pid, flush=True)
    time.sleep(1000)
"""


def wait_until(condition, what):
    deadline = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not happen"
        time.sleep(0.02)


def is_alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.fixture
def start(tmp_path):
    """Start a program as a child; it is gone after the test."""
    started = []

    def start(program, name="child"):
        (tmp_path / f"{name}_module.py").write_text(program)
        environment = {**os.environ, "PYTHONPATH": f"{REPOSITORY}:{tmp_path}"}
        child = Child(name, f"{name}_module", [], environment, tmp_path)
        started.append(child)
        return child

    yield start
    for child in started:
        if child.exit_code is None:
            os.kill(child.pid, signal.SIGKILL)
        child.wait(WAIT)


def wait_until_ready(child):
    wait_until(lambda: "ready" in child.log.read_text(), "the start")


def test_a_child_ends_by_itself_when_it_is_asked_to(start):
    child = start(POLITE)
    wait_until_ready(child)
    child.ask_to_end()
    assert child.wait(WAIT)
    child.close()
    assert child.exit_code == 0
    assert "good-bye" in child.log.read_text()


def test_a_child_ends_when_it_is_asked_to_also_where_a_shell_runs_its_parent_in_the_background(
    start,
):
    usual = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        child = start(POLITE)
    finally:
        signal.signal(signal.SIGINT, usual)
    wait_until_ready(child)
    child.ask_to_end()
    assert child.wait(WAIT)
    assert child.exit_code == 0


def test_a_child_that_is_interrupted_while_it_starts_says_nothing(start):
    child = start(SLOW_TO_START)
    wait_until_ready(child)
    child.ask_to_end()
    assert child.wait(WAIT)
    child.close()
    assert child.exit_code == INTERRUPTED
    assert child.log.read_text() == "ready\n"


def test_a_failed_child_is_named_with_its_last_error(start):
    child = start(FAILING, name="fragile")
    assert child.wait(WAIT)
    error = child.died()
    assert isinstance(error, VislamError)
    assert str(error) == (f"fragile ended early with exit code 1: the disk is full ({child.log})")


def test_a_child_that_crashes_in_compiled_code_is_named_with_what_it_was(start):
    child = start("import os\nos.abort()\n", name="crashing")
    assert child.wait(WAIT)
    assert str(child.died()) == (
        f"crashing ended early with signal 6 (SIGABRT): Fatal Python error: Aborted ({child.log})"
    )


def test_a_child_that_stands_still_is_seen_until_it_goes_on(start):
    child = start(POLITE)
    wait_until_ready(child)
    assert not child.is_stopped
    child.send(signal.SIGSTOP)
    wait_until(lambda: child.is_stopped, "the stop")
    child.ask_to_end()
    assert child.wait(WAIT)
    assert (child.exit_code, child.is_stopped) == (0, False)


def test_a_child_whose_end_another_thread_is_told_meanwhile_does_not_stand_still(
    start, monkeypatch
):
    child = start(POLITE)
    wait_until_ready(child)
    child.ask_to_end()
    os.waitpid(child.pid, 0)
    with monkeypatch.context() as just_before:
        just_before.setattr(processes.Child, "exit_code", None)
        assert not child.is_stopped


@pytest.fixture
def prepare(tmp_path, monkeypatch):
    """Prepare a program as the child "ready"; it is gone after the test."""
    monkeypatch.setenv("PYTHONPATH", f"{REPOSITORY}:{tmp_path}")
    with ExitStack() as stack:

        def prepare(program):
            (tmp_path / "ready_module.py").write_text(program)
            modules = {"ready": ("ready_module", "first")}
            return stack.enter_context(processes.prepared_children(modules))

        yield prepare


def test_a_prepared_child_runs_when_it_is_told_with_what_it_is_told(prepare, tmp_path):
    prepared = prepare(TOLD)
    children = Children({**os.environ, "MOOD": "glad"}, tmp_path, prepared)
    child = children.start("ready", "not_this_one", ["second", "third"])
    assert child is prepared["ready"]
    assert child.wait(WAIT)
    child.close()
    assert child.exit_code == 3
    assert child.log.read_text().splitlines() == [
        "imported",
        "prepared for first",
        "told first second third glad",
    ]


def test_a_prepared_child_that_is_never_told_ends_with_the_block(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{REPOSITORY}:{tmp_path}")
    (tmp_path / "ready_module.py").write_text(TOLD)
    with processes.prepared_children({"ready": ("ready_module",)}) as prepared:
        child = prepared["ready"]
        assert not child.has_begun
        assert child.exit_code is None
    assert child.exit_code == -signal.SIGKILL


def test_a_prepared_child_that_cannot_be_imported_is_named_with_its_error(prepare, tmp_path):
    children = Children(os.environ, tmp_path, prepare("raise RuntimeError('no such thing')\n"))
    child = children.start("ready", "ready_module", [])
    assert child.wait(WAIT)
    assert str(child.died()).startswith(
        "ready ended early with exit code 1: RuntimeError: no such thing"
    )


def test_a_prepared_child_that_fails_before_it_is_told_is_named_with_its_error(prepare):
    child = prepare("raise RuntimeError('no such thing')\n")["ready"]
    assert child.wait(WAIT)
    assert str(child.died()) == "ready ended early with exit code 1: RuntimeError: no such thing"


def test_a_prepared_child_does_not_outlive_its_parent(tmp_path):
    (tmp_path / "ready_module.py").write_text(TOLD)
    parent = subprocess.Popen(
        [sys.executable, "-c", PREPARING_PARENT],
        env={**os.environ, "PYTHONPATH": f"{REPOSITORY}:{tmp_path}"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        pid = int(parent.stdout.readline())
        assert is_alive(pid)
    finally:
        parent.kill()
        parent.wait(WAIT)
    wait_until(lambda: not is_alive(pid), "the end of the child")


@pytest.fixture
def start_children(tmp_path):
    """Start programs as the children of one run."""
    environment = {**os.environ, "PYTHONPATH": f"{REPOSITORY}:{tmp_path}"}
    children = Children(environment, tmp_path)

    def start(*programs):
        for k, program in enumerate(programs):
            (tmp_path / f"child_{k}_module.py").write_text(program)
        started = [children.start(f"child_{k}", f"child_{k}_module", []) for k in (0, 1)]
        for child in started:
            wait_until_ready(child)
        return children, started

    return start


def test_the_child_that_writes_is_told_after_the_others_that_it_is_the_last(start_children):
    children, (writer, other) = start_children(WRITER, POLITE)
    children.end(writer=writer)
    assert [child.exit_code for child in (writer, other)] == [0, 0]
    times = [int(child.log.read_text().split()[-1]) for child in (writer, other)]
    assert times[0] > times[1]


def test_a_child_that_does_not_listen_is_made_to_end(start_children, monkeypatch):
    monkeypatch.setattr(processes, "_ENDING", ((signal.SIGINT, 0.2), (signal.SIGKILL, WAIT)))
    children, (polite, deaf) = start_children(POLITE, DEAF)
    children.end()
    assert (polite.exit_code, deaf.exit_code) == (0, -signal.SIGKILL)


@pytest.mark.parametrize("program", [POLITE, DEAF])
def test_a_killed_parent_leaves_no_child(tmp_path, program):
    (tmp_path / "child_module.py").write_text(program)
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, "child_module", str(tmp_path)],
        env={**os.environ, "PYTHONPATH": f"{REPOSITORY}:{tmp_path}"},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        pid = int(parent.stdout.readline())
        wait_until(lambda: "ready" in (tmp_path / "child.log").read_text(), "the start")
        assert is_alive(pid)
    finally:
        parent.kill()
        parent.wait(WAIT)
    wait_until(lambda: not is_alive(pid), "the end of the child")


def test_domains_taken_at_the_same_time_differ():
    with own_domain() as one, own_domain() as two:
        assert one != two
        assert {one, two} <= set(range(1, 102))
    with own_domain() as again:
        assert again == one
