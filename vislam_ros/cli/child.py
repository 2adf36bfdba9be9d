# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run a module as a child that never outlives its parent: ``python -m ... MODULE ARGS``.

The parent holds the other end of standard input. However it ends, even by SIGKILL, the kernel
closes that end, and this process asks itself to end, then makes itself.

With ``--when-told`` before MODULE the process imports it, which has a function ``main`` and maybe
another ``prepare`` that takes ARGS, and calls it when a line of JSON comes on standard input: more
arguments, and what is to be different in the environment.
"""

import faulthandler
import importlib
import json
import os
import queue
import runpy
import signal
import sys
import threading
import time
from typing import Any

from vislam_ros.cli.exit_codes import INTERRUPTED
from vislam_ros.importing import importing

WHEN_TOLD = "--when-told"

_GRACE_SECONDS = 5.0


def _end_with_parent(told: "queue.SimpleQueue[bytes]") -> None:
    # Of a process that is just made to go on, the kernel gives a signal to any thread that takes
    # it, and the main one would sleep on.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1))
    line = b""
    while part := os.read(0, 65536):
        line += part
        if line.endswith(b"\n"):
            told.put(line)
            line = b""
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE_SECONDS)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Watch the parent from a thread and run the module that the arguments name."""
    told: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_end_with_parent, args=(told,), daemon=True).start()
    # The parent ends it with SIGINT, which all ignore that a shell started in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    faulthandler.enable()  # a crash in compiled code says what it was
    del sys.argv[0]
    try:
        if sys.argv[0] != WHEN_TOLD:
            runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
            return
        del sys.argv[0]
        module = _prepared()
        news = json.loads(told.get())
        os.environ.update(news["environment"])
        sys.argv += news["arguments"]
        sys.exit(module.main())
    except KeyboardInterrupt:
        # While it was still importing; later a module takes its signals itself.
        sys.exit(INTERRUPTED)


def _prepared() -> Any:
    """Import the module that the arguments name, and let it get ready for those after it."""
    with importing():
        module = importlib.import_module(sys.argv[0])
        sys.argv[0] = str(module.__file__)
        if hasattr(module, "prepare"):
            module.prepare(sys.argv[1:])
    return module


if __name__ == "__main__":
    main()
