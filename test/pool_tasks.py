# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Functions for worker processes, which find them by name."""

import os
import signal

MURDEROUS, WRONG = 1, 2


def scaled(factor: int, task: int) -> int:
    """A task that works, one that raises and one that ends its process."""
    if task == -MURDEROUS:
        os.kill(os.getpid(), signal.SIGKILL)
    if task == -WRONG:
        raise ValueError(f"{task} is no task")
    return factor * task


def process_id(_: None, __: int) -> int:
    return os.getpid()
