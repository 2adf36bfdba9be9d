# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that claim more than they hold: records, chunks, indices, tables and metadata."""

import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import zstandard

from reliability.fuzzing.repairs import plain_mcap

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _MESSAGE, _CHUNK, _CHUNK_INDEX = 3, 5, 6, 8


def bags(folder: Path, bag: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile bags below a folder; yields what each is, and its path."""
    whole = next(bag.glob("*.mcap")).read_bytes()
    plain = plain_mcap(whole)
    header_end = len(_MAGIC) + 9 + struct.unpack_from("<Q", plain, len(_MAGIC) + 1)[0]
    start, rest = plain[:header_end], plain[header_end:]
    bomb = zstandard.ZstdCompressor(level=1).compress(bytes(1 << 28))
    frame = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(1 << 28))
    records = {
        "record of a claimed length": bytes([_MESSAGE]) + struct.pack("<Q", 1 << 50),
        "schema of megabytes": _record(
            _SCHEMA,
            struct.pack("<H", 9) + _text("a/b") + _text("ros2msg") + _text("x" * (1 << 20)),
        ),
        "chunk that claims to unpack": _chunk(b"x", "", 1 << 60),
        "chunk of zeros": _chunk(bomb, "zstd", 1 << 28),
        "chunk that unpacks to more": _chunk(frame, "zstd", 1000),
        "index to nowhere": _record(
            _CHUNK_INDEX,
            struct.pack("<QQQQL", 0, 1, 50, 60, 0)
            + struct.pack("<Q", 0)
            + _text("zstd")
            + struct.pack("<QQ", 1 << 40, 1 << 40),
        ),
    }
    for number, (name, record) in enumerate(records.items()):
        path = folder / f"bag_{number}.mcap"
        path.write_bytes(start + record + rest)
        yield f"MCAP: {name}", path
    for name, content in (("cut off", whole[: len(whole) // 2]), ("empty", b""), ("text", b"no")):
        path = folder / f"{name.replace(' ', '_')}.mcap"
        path.write_bytes(content)
        yield f"MCAP: {name}", path
    metadata = (bag / "metadata.yaml").read_text()
    texts = {
        "nested metadata": "[" * 50_000,
        "aliased metadata": "a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]\n",
        "metadata of megabytes": metadata + "#" * (4 << 20),
        "metadata of another version": metadata.replace("version: 9", "version: 99"),
    }
    for number, (name, text) in enumerate(texts.items()):
        copy = folder / f"bag_directory_{number}"
        shutil.copytree(bag, copy)
        (copy / "SHA256SUMS").unlink()
        (copy / "provenance.json").unlink()
        (copy / "metadata.yaml").write_text(text)
        yield f"bag: {name}", copy
    yield "database that makes its rows up", _view(folder / "view.db3")


def _text(text: str) -> bytes:
    return struct.pack("<L", len(text)) + text.encode()


def _record(opcode: int, content: bytes) -> bytes:
    return bytes([opcode]) + struct.pack("<Q", len(content)) + content


def _chunk(packed: bytes, compression: str, size: int) -> bytes:
    content = struct.pack("<QQQL", 0, 1, size, 0) + _text(compression)
    return _record(_CHUNK, content + struct.pack("<Q", len(packed)) + packed)


def _view(path: Path) -> Path:
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,"
            " serialization_format TEXT, offered_qos_profiles TEXT);"
            "CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1"
            " FROM c) SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(9) AS data FROM c;"
        )
    return path
