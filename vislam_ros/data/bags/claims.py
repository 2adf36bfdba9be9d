# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a bag claims, held against its bytes before a library believes it.

The readers of bags make room for whatever a record, a chunk or a compressed frame says of itself,
follow an index wherever it points, and open whatever file a bag names.
"""

import re
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple

from vislam_ros.data.bags.compressed_size import largest_size
from vislam_ros.data.files.inputs import check_regular, open_input, read_text
from vislam_ros.errors import VislamError

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _ATTACHMENT = 3, 4, 5, 6, 8, 9
# Writers make chunks of some megabytes; readers hold one whole [bytes].
_LARGEST_CHUNK = 128 << 20
# Of a type with all that it is made of [bytes].
_LARGEST_SCHEMA = 1 << 18
# All chunks of a bag together unpack to no more: features pack to a half, still images to less.
_LARGEST_RATIO, _ALWAYS = 200, 256 << 20
# metadata.yaml is a few levels deep, and ten characters a level.
_DEEPEST, _WIDEST_INDENT = 30, 120
_ALIAS = re.compile(r"(^|[\s\[{,:-])[*&][^\s\"']", re.MULTILINE)


class _Chunk(NamedTuple):
    begin: int
    length: int
    compression: bytes
    compressed_size: int
    uncompressed_size: int


def check_bag(path: Path) -> None:
    """Refuse a bag, a directory or a file, that claims more than it holds.

    Raises
    ------
    VislamError
    """
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    for file in files:
        if file.is_dir():
            continue
        check_regular(file, "this bag")
        if file.name == "metadata.yaml":
            _check_metadata(file)
        elif file.suffix == ".mcap":
            if fault := mcap_claim(file):
                raise VislamError(f"{file}: cannot read this bag: {fault}")
        elif file.suffix == ".db3":
            _check_tables(file)
        elif file.suffix in (".zst", ".zstd"):
            _check_packed(file)


def mcap_claim(path: Path) -> str | None:
    """Say what an MCAP file claims that cannot be; None where there is nothing of the kind."""
    with open_input(path, "this bag") as file:
        size = file.seek(0, 2)
        file.seek(0)
        if file.read(len(_MAGIC)) != _MAGIC:
            return None  # whoever reads it says so
        try:
            fault = _fault(file, size)
        except EOFError:
            fault = "a record is cut off"
    return f"truncated or damaged: {fault}" if fault else None


def _fault(file: BinaryIO, size: int) -> str | None:
    chunks: set[_Chunk] = set()
    unpacked = 0
    while file.tell() < size - len(_MAGIC):
        begin = file.tell()
        opcode, length = _number(file, 1), _number(file, 8)
        end = file.tell() + length
        if end > size:
            return f"a record at byte {begin} claims {length} bytes, more than there are"
        if opcode == _CHUNK:
            chunk = _read_chunk(file, begin, end)
            chunks.add(chunk)
            unpacked += chunk.uncompressed_size
            if fault := _chunk_fault(file, chunk, end):
                return fault
            if unpacked > _LARGEST_RATIO * size + _ALWAYS:
                return f"{size} bytes claim to unpack to more than {unpacked}"
        elif opcode == _CHUNK_INDEX and _read_index(file) not in chunks:
            return f"the index at byte {begin} speaks of a chunk that is not there"
        elif opcode == _SCHEMA and length > _LARGEST_SCHEMA:
            return f"the schema at byte {begin} has {length} bytes, more than any type"
        file.seek(end)
    return None


def _read_chunk(file: BinaryIO, begin: int, end: int) -> _Chunk:
    file.seek(16, 1)
    uncompressed_size, _crc = _number(file, 8), _number(file, 4)
    compression = _bytes(file, end)
    return _Chunk(begin, end - begin, compression, _number(file, 8), uncompressed_size)


def _read_index(file: BinaryIO) -> _Chunk:
    """Chunk that an index speaks of."""
    file.seek(16, 1)
    begin, length = _number(file, 8), _number(file, 8)
    file.seek(_number(file, 4), 1)
    file.seek(8, 1)
    compression = file.read(_number(file, 4) & 0xFF)
    return _Chunk(begin, length, compression, _number(file, 8), _number(file, 8))


def _chunk_fault(file: BinaryIO, chunk: _Chunk, end: int) -> str | None:
    """Fault of a chunk at whose compressed bytes the file stands."""
    where = f"the chunk at byte {chunk.begin}"
    if chunk.compressed_size > end - file.tell():
        return f"{where} claims {chunk.compressed_size} bytes, more than there are"
    claimed = chunk.uncompressed_size
    if claimed > _LARGEST_CHUNK:
        return f"{where} claims to unpack to {claimed} bytes, more than any writer makes"
    # Of a compression that is not known here a reader tells.
    compression = chunk.compression.decode("latin1")
    size = largest_size(file, file.tell() + chunk.compressed_size, compression)
    if size is not None and size > _LARGEST_CHUNK:
        return f"{where} unpacks to more than the {claimed} bytes that it claims"
    return None


def _check_metadata(path: Path) -> None:
    text = read_text(path, "this bag")
    depth = deepest = 0
    for char in text:
        depth += (char in "[{") - (char in "]}")
        deepest = max(deepest, depth)
    indent = max((len(line) - len(line.lstrip(" -?")) for line in text.splitlines()), default=0)
    if deepest > _DEEPEST or indent > _WIDEST_INDENT:
        raise VislamError(f"{path}: cannot read this bag: it is nested too deeply")
    if _ALIAS.search(text):
        raise VislamError(f"{path}: cannot read this bag: it has an anchor or an alias")


def _check_tables(path: Path) -> None:
    """Refuse a database that makes its rows up: views, virtual tables and computed columns."""
    try:
        address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as database:
            rows = list(database.execute("SELECT type, name, sql FROM sqlite_master LIMIT 1000"))
    except sqlite3.Error as error:
        raise VislamError(f"{path}: cannot read this bag: {error}") from error
    for kind, name, sql in rows:
        words = set(re.findall(r"\w+", str(sql).upper()))
        if kind not in ("table", "index") or words & {"VIRTUAL", "GENERATED", "AS"}:
            raise VislamError(
                f"{path}: cannot read this bag: {name} is made up by the database, not stored"
            )


def _check_packed(path: Path) -> None:
    with open_input(path, "this bag") as file:
        size = file.seek(0, 2)
        file.seek(0)
        unpacked = largest_size(file, size, "zstd")
    if unpacked is not None and unpacked > _LARGEST_RATIO * size + _ALWAYS:
        raise VislamError(
            f"{path}: cannot read this bag: {size} bytes claim to unpack to {unpacked}"
        )


def _number(file: BinaryIO, size: int) -> int:
    data = file.read(size)
    if len(data) < size:
        raise EOFError
    return int.from_bytes(data, "little")


def _bytes(file: BinaryIO, end: int) -> bytes:
    length = _number(file, 4)
    if length > end - file.tell():
        raise EOFError
    return file.read(length)
