# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a pickle claims, held against its bytes before any of it is done.

A few bytes of a pickle can ask for gigabytes: a length of what is to come, a place in a memo that
is an array, an integer of a million digits. Every opcode and its claim is looked at here, and
nothing is made. What calls make of what is there is bounded where they are made
(see restricted_pickle).
"""

import pickletools
from typing import IO, NamedTuple

_OPCODES = {ord(each.code): each for each in pickletools.opcodes}
_LENGTH_BYTES = {
    pickletools.TAKEN_FROM_ARGUMENT1: 1,
    pickletools.TAKEN_FROM_ARGUMENT4: 4,
    pickletools.TAKEN_FROM_ARGUMENT4U: 4,
    pickletools.TAKEN_FROM_ARGUMENT8U: 8,
}
_PLACED = frozenset({"PUT", "BINPUT", "LONG_BINPUT"})
_FETCHED = frozenset({"GET", "BINGET", "LONG_BINGET"})
_MEMOIZE = "MEMOIZE"
# No pickle of arrays has them, and what is on top of the stack is hard to tell with them.
_STRANGE = frozenset({"DUP", "POP", "POP_MARK", "PERSID", "BINPERSID"})
_LINES = {"GLOBAL": 2, "INST": 2}
# A frame's bytes are opcodes themselves.
_FRAME = "FRAME"

#: Arrays of numbers take some 15 opcodes each, numbers in lists one each.
MOST_OPCODES = 300_000
#: They nest, and their hashes go all the way down: enough of them overflow the stack.
MOST_TUPLES = 10_000
#: One tuple in many places is hashed in each: with a few dozen, in tuples of tuples, for ever.
MOST_SHARED_TUPLES = 16
#: Bytes that a pickler writes outside of its frames; so many or more can stay in the file.
LARGE = 64 * 1024
_BYTES = frozenset({"BINBYTES", "BINBYTES8", "BYTEARRAY8"})
# 64-bit integers with a sign, and what Python adds to them [bytes].
_LONGEST_INTEGER = 16


class Cut(NamedTuple):
    """An opcode from byte ``begin`` to ``end`` whose large bytes begin at ``data``.

    Those of a frame, which only tells how far to read ahead, begin nowhere.
    """

    begin: int
    end: int
    data: int | None


class Claims(NamedTuple):
    """What a pickle within the limits holds.

    Attributes
    ----------
    begin, end : int
        Where its bytes begin in the file, and behind its last one.
    size : int
        Bytes from its first to the end of the file.
    cuts : list of Cut
        In the order of the file.
    """

    begin: int
    end: int
    size: int
    cuts: list[Cut]


def check_claims(stream: IO[bytes]) -> Claims:
    """Look at a pickle, from where its file stands, and go back there.

    Parameters
    ----------
    stream : binary file
        Can be sought in.

    Raises
    ------
    ValueError
        Where it claims more than it holds, or is no pickle.
    """
    begin = stream.tell()
    end = stream.seek(0, 2)
    stream.seek(begin)
    opcodes = tuples = shared = memoized = 0
    tuple_on_top, tuple_places = False, set()
    name, cuts = "", []
    while name != "STOP":
        place_of_opcode = stream.tell()
        opcode = _OPCODES.get(_number(stream, 1))
        if opcode is None or opcode.name in _STRANGE:
            raise ValueError("no opcode of a pickle of arrays")
        name = opcode.name
        number = _argument(stream, opcode, end)
        if name == _FRAME:
            cuts.append(Cut(place_of_opcode, stream.tell(), None))
        elif name in _BYTES and number >= LARGE:
            cuts.append(Cut(place_of_opcode, stream.tell(), stream.tell() - number))
        opcodes += 1
        is_tuple = "TUPLE" in name
        tuples += is_tuple
        if name in _PLACED or name == _MEMOIZE:
            place = memoized if name == _MEMOIZE else number
            if place > opcodes:
                raise ValueError("a place in the memo far ahead")
            memoized += 1
            if tuple_on_top:
                tuple_places.add(place)
            continue
        tuple_on_top = is_tuple or (name in _FETCHED and number in tuple_places)
        shared += tuple_on_top and not is_tuple
        if opcodes > MOST_OPCODES or tuples > MOST_TUPLES or shared > MOST_SHARED_TUPLES:
            raise ValueError("more than arrays need")
    claims = Claims(begin, stream.tell(), end - begin, cuts)
    stream.seek(begin)
    return claims


def _argument(stream: IO[bytes], opcode: pickletools.OpcodeInfo, end: int) -> int:
    """Pass over an opcode's argument; return its number or its length where it has one, else 0."""
    size, name = 0 if opcode.arg is None else opcode.arg.n, opcode.name
    if size == pickletools.UP_TO_NEWLINE:
        for _ in range(_LINES.get(name, 1)):
            line = stream.readline()
        if name in ("LONG", "INT") and len(line) > 3 * _LONGEST_INTEGER:
            raise ValueError("a number of too many digits")
        return int(line[:20]) if name in _PLACED | _FETCHED else 0
    if size in _LENGTH_BYTES:
        length = _number(stream, _LENGTH_BYTES[size])
        if length > end - stream.tell():
            raise ValueError("a length of more than there is")
        if name in ("LONG1", "LONG4") and length > _LONGEST_INTEGER:
            raise ValueError("a number of too many digits")
        stream.seek(length, 1)
        return length
    number = _number(stream, size)
    if name == _FRAME and number > end - stream.tell():
        raise ValueError("a frame of more than there is")
    return number


def _number(stream: IO[bytes], size: int) -> int:
    data = stream.read(size)
    if len(data) < size:
        raise ValueError("cut off")
    return int.from_bytes(data, "little")
