# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Modules from outside the package: a user's own estimators and formats, imported by name."""

import importlib
import sys
from types import ModuleType

from vislam_ros.errors import VislamError


def import_outside(module: str) -> ModuleType:
    """Import a module that lies in the current folder or on the path of Python.

    Raises
    ------
    VislamError
        Saying why it cannot be imported, in a line.
    """
    # Commands that pip installs do not look into the current folder by themselves.
    if "" not in sys.path:
        sys.path.append("")
    try:
        return importlib.import_module(module)
    except Exception as error:  # of whatever kind: it is not our code
        raise VislamError(f"{module} cannot be imported: {in_a_line(error)}") from error


def in_a_line(error: Exception) -> str:
    """Kind and first line of an error."""
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
