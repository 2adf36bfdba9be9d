# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which arguments of a command are written, which are read, and that these are not the same."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vislam_ros.data.outputs import refuse_loss

#: Arguments that a command writes; all other paths it reads.
OUTPUTS = ("out", "output", "picture", "save")
_REPLACE_FOLDERS = ("convert", "simulate")


def check_paths(arguments: argparse.Namespace) -> None:
    """Refuse an output that would destroy what a command reads, before any work.

    Raises
    ------
    VislamError
    """
    given = vars(arguments)
    outputs = [path for name in OUTPUTS for path in _paths(given.get(name))]
    if arguments.command == "simulate" and not arguments.images:
        outputs += [path.with_suffix(".tum") for path in outputs]
    sources = [
        path for name, value in given.items() if name not in OUTPUTS for path in _paths(value)
    ]
    for output in outputs:
        for source in sources:
            refuse_loss(output, source, replaces_folder=arguments.command in _REPLACE_FOLDERS)


def _paths(value: Any) -> Iterator[Path]:
    for each in value if isinstance(value, list) else [value]:
        if isinstance(each, Path):
            yield each
