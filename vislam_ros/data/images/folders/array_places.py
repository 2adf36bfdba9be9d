# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the arrays of a pickle lie in its file, so that they can be read one at a time.

A pickle is a program. Here it is walked on a stack that knows only plain containers and the few
calls with which numpy describes an array; nothing is imported, called or hashed, and no array's
bytes are read. Whatever else it names is refused.
"""

import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import IO, Any, NamedTuple

import numpy as np

from vislam_ros.errors import VislamError

_OPCODES = {ord(each.code): each for each in pickletools.opcodes}
_BYTES = {
    "SHORT_BINBYTES": 1,
    "BINBYTES": 4,
    "BINBYTES8": 8,
    "BYTEARRAY8": 8,
    "SHORT_BINSTRING": 1,
    "BINSTRING": 4,
}
_TEXTS = {"SHORT_BINUNICODE": 1, "BINUNICODE": 4, "BINUNICODE8": 8}
_LONGEST_TEXT = 1 << 10
_INTEGERS = {"BININT": 4, "BININT1": 1, "BININT2": 2}
_LONGEST_INTEGER = 16
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
#: No image is smaller: so a file has no more of them than its length allows [bytes].
FEWEST_BYTES = 1 << 10
# An image takes some 30 opcodes, and a few are for the containers around them.
_OPCODES_OF_AN_IMAGE, _OPCODES_ALWAYS = 64, 1000
_MODULES = ("numpy", "numpy.core.", "numpy._core.")
_BUILT = ("_reconstruct", "_frombuffer", "dtype")


class Place(NamedTuple):
    """Bytes of a file: where they begin, and how many they are."""

    offset: int
    length: int


@dataclass
class LocatedArray:
    """An array that stands in a file.

    Attributes
    ----------
    shape : tuple of int
    dtype : dtype
    fortran_order : bool
        Whether the first index runs fastest, not the last.
    place : Place
    content : object
        What an array of objects of shape () holds; None in one of numbers.
    """

    shape: tuple[int, ...] = ()
    dtype: np.dtype[Any] = field(default_factory=lambda: np.dtype(np.uint8))
    fortran_order: bool = False
    place: Place = field(default_factory=lambda: Place(0, 0))
    content: Any = None


@dataclass
class _Dtype:
    dtype: np.dtype[Any]


class _Name(NamedTuple):
    module: str
    name: str


class _Mark:
    """Where a group of things on the stack begins."""


class _Malformed(Exception):
    """It is no pickle, or a damaged one."""


def locate_arrays(stream: IO[bytes], source: str) -> Any:
    """Plain containers of a pickle, with a :class:`LocatedArray` for each of its arrays.

    Parameters
    ----------
    stream : binary file
        At the pickle's first byte; can be sought in.
    source : str
        What to call it in an error.

    Raises
    ------
    VislamError
        Where it names anything but arrays, is cut off or damaged, or of a protocol that does not
        keep an array's bytes as they are.
    """
    try:
        return _Walk(stream, source).result()
    except VislamError:
        raise
    except Exception as error:  # a broken pickle may raise anything
        raise VislamError(f"{source}: its pickle is cut off or damaged: copy it anew") from error


class _Walk:
    """A pickle's stack and memo."""

    def __init__(self, stream: IO[bytes], source: str):
        self._stream = stream
        self._source = source
        begin = stream.tell()
        self._end = stream.seek(0, 2)
        stream.seek(begin)
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}

    def result(self) -> Any:
        left = _OPCODES_ALWAYS
        while True:
            opcode = _OPCODES.get(self._number(1))
            left -= 1
            if opcode is None or left < 0:
                raise _Malformed
            if opcode.name == "STOP":
                return _opened(self._pop())
            self._do(opcode)
            if opcode.name in _BYTES and self._stack[-1].length >= FEWEST_BYTES:
                left += _OPCODES_OF_AN_IMAGE

    def _do(self, opcode: pickletools.OpcodeInfo) -> None:
        name, stack = opcode.name, self._stack
        if name in _BYTES:
            stack.append(self._place(self._number(_BYTES[name])))
        elif name in _TEXTS:
            stack.append(self._text(self._number(_TEXTS[name])))
        elif name in _INTEGERS:
            stack.append(self._number(_INTEGERS[name], signed=name == "BININT"))
        elif name == "LONG1":
            size = self._number(1)
            if size > _LONGEST_INTEGER:
                raise _Malformed
            stack.append(self._number(size, signed=True))
        elif name == "BINFLOAT":
            stack.append(None)
            self._number(8)
        elif name in _CONSTANTS:
            stack.append(_CONSTANTS[name])
        elif name in _TUPLES:
            count = _TUPLES[name]
            items = tuple(self._pop() for _ in range(count))[::-1]
            stack.append(items)
        elif name == "TUPLE":
            stack.append(tuple(self._group()))
        elif name == "EMPTY_LIST":
            stack.append([])
        elif name == "EMPTY_DICT":
            stack.append({})
        elif name == "MARK":
            stack.append(_Mark())
        elif name in ("APPEND", "APPENDS"):
            new = self._group() if name == "APPENDS" else [self._pop()]
            self._top(list).extend(new)
        elif name in ("SETITEM", "SETITEMS"):
            pairs = self._group() if name == "SETITEMS" else [self._pop(), self._pop()][::-1]
            self._set(pairs)
        elif name in ("MEMOIZE", "BINPUT", "LONG_BINPUT"):
            place = len(self._memo) if name == "MEMOIZE" else self._memo_place(name)
            self._memo[place] = stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            stack.append(self._memo[self._memo_place(name)])
        elif name == "GLOBAL":
            stack.append(_Name(self._line(), self._line()))
        elif name == "STACK_GLOBAL":
            symbol, module = self._pop(), self._pop()
            stack.append(_Name(str(module), str(symbol)))
        elif name == "REDUCE":
            arguments, function = self._pop(), self._pop()
            stack.append(self._called(function, arguments))
        elif name == "BUILD":
            state = self._pop()
            _build(stack[-1], state)
        elif name == "PROTO":
            self._number(1)
        elif name == "FRAME":
            self._number(8)
        else:
            raise VislamError(
                f"{self._source}: its pickle holds more than arrays and plain containers "
                f"({name}): save it anew with numpy.save"
            )

    def _called(self, function: Any, arguments: Any) -> Any:
        """What numpy's descriptions of an array make; no function runs."""
        name = function.name if isinstance(function, _Name) else ""
        is_numpy = name and function.module.startswith(_MODULES)
        if not is_numpy or name not in _BUILT:
            what = ".".join(function) if name else type(function).__name__
            raise VislamError(
                f"{self._source}: holds {ascii(what)[1:-1]}, which is refused: only numpy arrays "
                "and plain containers are read from a pickle"
            )
        if name == "_reconstruct":
            return LocatedArray()
        if name == "dtype":
            return _Dtype(_dtype(arguments[0]))
        data, dtype, shape, order = arguments[:4]
        array = LocatedArray()
        _fill(array, shape, dtype.dtype, order == "F", data)
        return array

    def _set(self, items: list[Any]) -> None:
        target = self._top(dict)
        for key, value in zip(items[::2], items[1::2], strict=True):
            if not isinstance(key, str):
                raise _Malformed
            target[key] = value

    def _top(self, kind: Callable[[], Any]) -> Any:
        if type(self._stack[-1]) is not kind:
            raise _Malformed
        return self._stack[-1]

    def _pop(self) -> Any:
        value = self._stack.pop()
        if isinstance(value, _Mark):
            raise _Malformed
        return value

    def _group(self) -> list[Any]:
        """Things since the last mark."""
        items = []
        while not isinstance(value := self._stack.pop(), _Mark):
            items.append(value)
        return items[::-1]

    def _memo_place(self, name: str) -> int:
        return self._number(4 if name.startswith("LONG") else 1)

    def _place(self, length: int) -> Place:
        place = Place(self._stream.tell(), length)
        if length > self._end - place.offset:
            raise _Malformed
        self._stream.seek(length, 1)
        return place

    def _text(self, length: int) -> str:
        if length > _LONGEST_TEXT:
            raise VislamError(
                f"{self._source}: keeps arrays as text, as old protocols do: save it anew with "
                "numpy.save in Python 3"
            )
        return self._stream.read(length).decode("utf-8", "replace")

    def _line(self) -> str:
        return self._stream.readline(_LONGEST_TEXT).decode("ascii", "replace").rstrip("\n")

    def _number(self, size: int, *, signed: bool = False) -> int:
        data = self._stream.read(size)
        if len(data) < size:
            raise _Malformed
        return int.from_bytes(data, "little", signed=signed)


def _build(target: Any, state: Any) -> None:
    """Give an array what its state says, or a dtype its byte order."""
    if isinstance(target, _Dtype):
        order, subarray, names = state[1:4]
        if subarray is not None or names is not None:
            raise _Malformed
        if order in ("<", ">"):
            target.dtype = target.dtype.newbyteorder(order)
    elif isinstance(target, LocatedArray):
        shape, dtype, is_fortran, data = state[-4:]
        _fill(target, shape, dtype.dtype, bool(is_fortran), data)
    else:
        raise _Malformed


def _fill(
    target: LocatedArray, shape: Any, dtype: np.dtype[Any], is_fortran: bool, data: Any
) -> None:
    if dtype.hasobject:
        if shape != () or len(data) != 1:
            raise _Malformed
        target.content = data[0]
        return
    count = 1
    for n in shape:
        if type(n) is not int or n < 0:
            raise _Malformed
        count *= n
    if not isinstance(data, Place) or data.length != count * dtype.itemsize:
        raise _Malformed
    target.shape, target.dtype, target.place = tuple(shape), dtype, data
    target.fortran_order = is_fortran


def _dtype(code: Any) -> np.dtype[Any]:
    if not isinstance(code, str) or len(code) > 4:
        raise _Malformed
    return np.dtype(code)


def _opened(value: Any) -> Any:
    """Content of an object array of shape (), or the value itself."""
    is_holder = isinstance(value, LocatedArray) and value.content is not None
    return value.content if is_holder else value
