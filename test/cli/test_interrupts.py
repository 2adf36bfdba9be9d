# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An interrupt ends a command as such, wherever it strikes."""

import os
import signal
import subprocess
import sys

import pytest
from places import REPOSITORY

from vislam_ros.cli.exit_codes import INTERRUPTED
from vislam_ros.cli.interrupts import held_interrupts, is_interrupt

WAIT = 60.0
INTERRUPTS = [signal.SIGINT, signal.SIGTERM]

IN_COMPILED_CODE = """\
import os, signal, threading
import numpy as np
from vislam_ros.cli.interrupts import take_interrupts
from vislam_ros.core.geometry.camera import StereoCamera

take_interrupts()
camera = StereoCamera.from_matrices(np.diag([500.0, 500.0, 1.0]), 0.5, np.eye(4))
y = np.tile([30.0, 10.0, 5.0], (500, 1))
caught = 0
while caught < 40:
    try:
        threading.Timer(0.01, os.kill, (os.getpid(), NUMBER)).start()
        while True:
            camera.warp(y, np.eye(4))
    except KeyboardInterrupt:
        caught += 1
print(caught)
"""
IN_A_FINALIZER = """\
import os, signal, time
from vislam_ros.cli.interrupts import take_interrupts

class Finalized:
    def __del__(self):
        os.kill(os.getpid(), NUMBER)
        time.sleep(0.01)

take_interrupts()
try:
    Finalized()
    time.sleep(60.0)
except KeyboardInterrupt:
    print("caught")
"""
WHILE_IT_IMPORTS = """\
import os, signal, sys
from vislam_ros.cli import main

class Interrupting:
    def find_spec(self, name, path, target=None):
        if name == "vislam_ros.cli.parser":
            os.kill(os.getpid(), NUMBER)

sys.meta_path.insert(0, Interrupting())
sys.exit(main.main(["solve", "drive.npz", "--out", "out"]))
"""


def run(program, number):
    return subprocess.run(
        [sys.executable, "-c", f"NUMBER = {int(number)}\n{program}"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=WAIT,
        check=False,
    )


@pytest.mark.parametrize("number", INTERRUPTS)
@pytest.mark.parametrize(
    ("program", "says"), [(IN_COMPILED_CODE, "40\n"), (IN_A_FINALIZER, "caught\n")]
)
def test_an_interrupt_arrives_as_one(program, says, number):
    ended = run(program, number)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, says, "")


@pytest.mark.parametrize("number", INTERRUPTS)
def test_an_interrupt_while_a_command_imports_ends_it_in_one_line(number):
    ended = run(WHILE_IT_IMPORTS, number)
    assert (ended.returncode, ended.stderr) == (INTERRUPTED, "interrupted\n")


def test_an_error_that_an_interrupt_has_caused_is_one():
    error = SystemError("returned a result with an exception set")
    assert not is_interrupt(error)
    error.__cause__ = KeyboardInterrupt()
    assert is_interrupt(error)
    assert is_interrupt(error.__cause__)


def test_a_held_interrupt_strikes_when_the_block_is_done():
    done = []

    def work():
        with held_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]
