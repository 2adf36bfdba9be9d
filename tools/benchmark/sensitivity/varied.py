# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Another value in the place of a constant, for a while."""

import functools
import importlib
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import ModuleType
from typing import Any
from unittest import mock

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from benchmark.sensitivity.constants import Constant, Value

_PACKAGE = "vislam_ros"


@contextmanager
def varied(constant: Constant, value: Value) -> Iterator[None]:
    """Give a module's constant another value, in this process and while the context lasts.

    Every module that has imported it gets the new one. A compiled function has taken the value
    in, so those that use it are compiled anew.
    """
    module = importlib.import_module(constant.path)
    old_value = getattr(module, constant.name)
    new = np.array(value) if isinstance(old_value, np.ndarray) else value
    changed = {constant.name}
    with ExitStack() as changes:
        for holder in _importers(constant, old_value):
            changes.enter_context(mock.patch.object(holder, constant.name, new))
        changes.enter_context(mock.patch.object(module, constant.name, new))
        # In the module's order: later functions call earlier ones.
        for name, old in list(vars(module).items()):
            if not isinstance(old, Dispatcher) or changed.isdisjoint(
                old.py_func.__code__.co_names
            ):
                continue
            changed.add(name)
            again = _compiled_anew(old, constant, value)
            for holder, known_as in _places_of(old):
                changes.enter_context(mock.patch.object(holder, known_as, again))
        yield


def _importers(constant: Constant, value: Any) -> list[ModuleType]:
    """Other modules that know a constant, which is never one with an underscore."""
    return [
        module
        for module, name in _places_of(value)
        if name == constant.name and not name.startswith("_") and module.__name__ != constant.path
    ]


@functools.cache
def _compiled_anew(function: Any, constant: Constant, value: Value) -> Any:
    """Compile a function with what it finds in its module now: a constant of another value."""
    signatures = list(function.nopython_signatures)
    return numba.njit(signatures, error_model="numpy")(function.py_func)


def _places_of(thing: Any) -> list[tuple[ModuleType, str]]:
    """Modules of the package that know a thing, and by which name."""
    return [
        (module, name)
        for path, module in list(sys.modules.items())
        if path.split(".")[0] == _PACKAGE
        for name, value in vars(module).items()
        if value is thing
    ]
