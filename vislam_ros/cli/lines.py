# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines that a command says: each is one, whatever is in the names that it tells."""

import shlex
import sys

from vislam_ros.errors import one_line


def tell(text: str) -> None:
    """Print a line on standard error."""
    print(one_line(text), file=sys.stderr)


def answer(text: str) -> None:
    """Print a line on standard output."""
    print(one_line(text))


def tell_next(*words: str) -> None:
    """Print on standard error the command of ``vislam`` that comes next, ready to be pasted."""
    tell(f"next: {shlex.join(['vislam', *words])}")
