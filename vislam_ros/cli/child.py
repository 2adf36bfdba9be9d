# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Run a module as a child that never outlives its parent: ``python -m ... MODULE ARGS``.

The parent holds the other end of standard input. However it ends, even by SIGKILL, the kernel
closes that end, and this process asks itself to end, then makes itself.
"""

import faulthandler
import os
import runpy
import signal
import sys
import threading
import time

from vislam_ros.cli.exit_codes import INTERRUPTED

_GRACE_SECONDS = 5.0


def _end_with_parent() -> None:
    # Of a process that is just made to go on, the kernel gives a signal to any thread that takes
    # it, and the main one would sleep on.
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE_SECONDS)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Watch the parent from a thread and run the module that the arguments name."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # The parent ends it with SIGINT, which all ignore that a shell started in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    faulthandler.enable()  # a crash in compiled code says what it was
    del sys.argv[0]
    try:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        # While it was still importing; later a module takes its signals itself.
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
