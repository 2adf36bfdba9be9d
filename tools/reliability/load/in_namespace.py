# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run a module in a network namespace: ``python -m reliability.load.in_namespace NAME MODULE``.

Python has ``os.setns`` only from 3.12 on.
"""

import ctypes
import os
import runpy
import sys
from pathlib import Path

_NETWORK = 0x40000000  # CLONE_NEWNET


def enter(name: str) -> None:
    """Enter the namespace with all sockets that are opened from now on."""
    libc = ctypes.CDLL(None, use_errno=True)
    with (Path("/run/netns") / name).open("rb") as namespace:
        if libc.setns(namespace.fileno(), _NETWORK) != 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), name)


if __name__ == "__main__":
    del sys.argv[0]
    enter(sys.argv.pop(0))
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
