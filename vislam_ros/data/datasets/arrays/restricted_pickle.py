# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pickles of numpy arrays and plain containers, read without running anything they name.

A pickle is a program that may call whatever it can import. Here it can reach only the stand-ins
below. They record the few calls with which numpy describes an array and build it from plain
bytes, so neither the pickle's functions nor numpy's own unpickling code ever runs.
"""

import math
import pickle
import reprlib
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.datasets.arrays.pickle_limits import Claims, check_claims
from vislam_ros.data.datasets.arrays.stored_array import (
    StoredArray,
    StoredBytes,
    without_large_bytes,
)
from vislam_ros.errors import VislamError

_KINDS = "biufcSU"  # numbers and text: whatever a dtype can say without pointers
_LONGEST_CODE = 16  # characters of a dtype
_MOST_DIMENSIONS = 32
# Calls may copy what is there, but not over and over: a pickle makes no more than so many times
# its own bytes, and a few more. What they make of an item takes about so much [bytes].
_TIMES_ITS_BYTES, _ALWAYS, _ITEM = 4, 1 << 20, 64


class _Refused(VislamError):
    """Something in a pickle that is no array and no plain container."""


class _Dtype:
    """What ``numpy.dtype(...)`` makes inside a pickle; a later state sets its byte order."""

    def __init__(self, code: Any, *_flags: Any):
        if not isinstance(code, str) or len(code) > _LONGEST_CODE:
            raise _Refused(f"the dtype {reprlib.repr(code)}")
        self.dtype = np.dtype(code)
        if self.dtype.kind not in _KINDS + "O":
            raise _Refused(f"the dtype {code!r}")

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _version, byte_order, subarray, names, fields = state[:5]
        if subarray is not None or names is not None or fields is not None:
            raise _Refused("a dtype with fields")
        if byte_order in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(byte_order)


class _Array:
    """An array inside a pickle: numbers, or the one object of a 0-d object array."""

    content: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        shape, dtype, is_fortran, data = state[-4:]
        if dtype.dtype.hasobject:
            if shape != () or len(data) != 1:
                raise _Refused(f"an array of objects of shape {reprlib.repr(shape)}")
            self.content = data[0]
        else:
            self.content = _from_bytes(data, dtype, shape, "F" if is_fortran else "C")


class _StandIn(NamedTuple):
    """A function that a pickle may call but, being a tuple, cannot alter."""

    function: Callable[..., Any]

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)


def _from_bytes(
    data: Any, dtype: _Dtype, shape: tuple[int, ...], order: Any
) -> NDArray[Any] | StoredArray:
    """Array of its bytes, or of their place where they are still in the file."""
    if isinstance(data, StoredBytes) and order in ("C", "F"):
        _check_shape(data, dtype, shape)
        return StoredArray(tuple(shape), dtype.dtype, order == "F", data)
    return _in_memory(data, dtype, shape, order)


def _in_memory(data: Any, dtype: _Dtype, shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    data = _held(data)
    if isinstance(data, str):  # Python 2 wrote bytes as text
        data = data.encode("latin1")
    _check_shape(data, dtype, shape)
    if len(data) == 0:
        return np.empty(shape, dtype.dtype)
    return np.frombuffer(data, dtype.dtype).reshape(shape, order=order)


def _check_shape(data: Any, dtype: _Dtype, shape: tuple[int, ...]) -> None:
    if dtype.dtype.hasobject:
        raise _Refused("an array of objects")
    if len(shape) > _MOST_DIMENSIONS or min(shape, default=0) < 0:
        raise ValueError("no shape of an array")
    count = math.prod(shape)
    if len(data) != count * dtype.dtype.itemsize or (count and not len(data)):
        raise ValueError("an array's shape does not fit its bytes")


def _held(data: Any) -> Any:
    return data.whole if isinstance(data, StoredBytes) else data


def _reconstruct(subtype: Any, *_arguments: Any) -> _Array:
    if subtype != _NDARRAY:
        raise _Refused("an array type of its own")
    return _Array()


def _scalar(dtype: _Dtype, data: Any) -> Any:
    return _in_memory(data, dtype, (), "C")[()]


def _frombuffer(data: Any, dtype: _Dtype, shape: Any, order: Any, axes: Any = None) -> _Array:
    array = _Array()
    if order == "K" and axes is not None:
        array.content = _in_memory(data, dtype, shape, "C").transpose(axes)
    else:
        array.content = _from_bytes(data, dtype, shape, order)
    return array


def _encode(text: Any, encoding: Any) -> bytes:
    if encoding not in ("latin1", "latin-1"):
        raise _Refused(f"the encoding {reprlib.repr(encoding)}")
    return bytes(text.encode("latin1"))


_NDARRAY = "numpy.ndarray"
_NUMPY: dict[str, Any] = {"ndarray": _NDARRAY, "dtype": _StandIn(_Dtype)}
_MULTIARRAY: dict[str, Any] = {
    "_reconstruct": _StandIn(_reconstruct),
    "scalar": _StandIn(_scalar),
}
_NUMERIC: dict[str, Any] = {"_frombuffer": _StandIn(_frombuffer)}
_BUILTINS: dict[str, Any] = {
    kind.__name__: kind for kind in (set, frozenset, bytes, bytearray, complex)
}
_REACHABLE: dict[str, dict[str, Any]] = {
    "numpy": _NUMPY,
    "numpy.core.multiarray": _MULTIARRAY,
    "numpy._core.multiarray": _MULTIARRAY,
    "numpy.core.numeric": _NUMERIC,
    "numpy._core.numeric": _NUMERIC,
    "builtins": _BUILTINS,
    "__builtin__": _BUILTINS,
    "collections": {"OrderedDict": OrderedDict},
    "_codecs": {"encode": _encode},
}


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: IO[bytes], claims: Claims, stored: list[StoredBytes]):
        super().__init__(stream, encoding="latin1")
        self._left = _TIMES_ITS_BYTES * claims.size + _ALWAYS
        self._stored = stored

    def persistent_load(self, pid: Any) -> Any:
        """Bytes that were left in the file (see without_large_bytes); no pickle asks for it."""
        return self._stored[pid]

    def find_class(self, module: str, name: str) -> Any:
        try:
            found = _REACHABLE[module][name]
        except KeyError:
            raise _Refused(f"{module}.{name}") from None
        is_ready = isinstance(found, (_StandIn, str))
        return found if is_ready else _StandIn(partial(self._copied, found))

    def _copied(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call what makes a copy of its arguments, as long as there is room for one."""
        for argument in arguments:
            if isinstance(argument, int):
                raise _Refused("bytes of a claimed length")
            if hasattr(argument, "__len__"):
                is_text = isinstance(argument, (str, bytes, bytearray, StoredBytes))
                self._left -= len(argument) * (1 if is_text else _ITEM)
        if self._left < 0:
            raise _Refused("more copies than its bytes hold")
        return function(*map(_held, arguments))


def _plain(value: Any) -> Any:
    if isinstance(value, _Dtype):
        return value.dtype
    if not isinstance(value, _Array):
        return _held(value)
    if isinstance(value.content, _Array):
        raise _Refused("an array of arrays")
    return value.content


def load_plain(stream: IO[bytes], source: str, *, leave_large: bool = False) -> Any:
    """Read a pickle of numpy arrays and plain containers; an object array of shape () is opened.

    Parameters
    ----------
    stream : binary file
        At the pickle's first byte.
    source : str
        What to call it in an error.
    leave_large : bool, optional
        Whether large arrays in a dict are left in the file, as a StoredArray, which must then stay
        open; where they cannot be, as those with their axes permuted, they are held.

    Returns
    -------
    object
        An array, a number, text or a container. The values of a dict may be arrays.

    Raises
    ------
    VislamError
        Where the pickle names anything else, which is then in the message and was not run, or
        where it is damaged.
    """
    try:
        claims, stored = check_claims(stream), list[StoredBytes]()
        if leave_large:
            stream, stored = without_large_bytes(stream, claims)
        content = _plain(_Unpickler(stream, claims, stored).load())
        if isinstance(content, dict):
            content = {key: _plain(value) for key, value in content.items()}
    except _Refused as refused:
        raise VislamError(
            f"{source}: holds {ascii(str(refused))[1:-1]}, which is refused: only numpy arrays "
            "and plain containers are read from a pickle"
        ) from None
    except Exception as error:  # a broken pickle may raise anything
        raise VislamError(f"{source}: its pickle is cut off or damaged") from error
    return content
