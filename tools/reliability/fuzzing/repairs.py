# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksums and lengths put right in files that were changed, so that a reader goes on."""

import io
import struct
import zipfile
from zlib import crc32

import zstandard

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _CHUNK, _DATA_END = 2, 6, 15
_LOCAL = struct.Struct("<4s5H3L2H")


def mended_archive(data: bytes) -> bytes:
    """Zip archive of the same members, stored and with their CRCs; of no archive, the bytes."""
    members = []
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for info in archive.infolist()[:20]:
                if info.compress_type:
                    members.append((info.filename, archive.read(info)))
                    continue
                begin = info.header_offset
                fields = _LOCAL.unpack_from(data, begin)
                begin += _LOCAL.size + fields[-2] + fields[-1]
                members.append((info.filename, data[begin : begin + info.file_size]))
    except Exception:  # whatever zipfile says of it, it stays as it is
        return data
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, member in members:
            archive.writestr(zipfile.ZipInfo(name), member)
    return content.getvalue()


def plain_mcap(data: bytes) -> bytes:
    """MCAP file with chunks that are not compressed and without a summary."""
    content, place = bytearray(_MAGIC), len(_MAGIC)
    while data[place] not in (_FOOTER, _DATA_END):
        (length,) = struct.unpack_from("<Q", data, place + 1)
        record = data[place + 9 : place + 9 + length]
        if data[place] == _CHUNK:
            (name,) = struct.unpack_from("<L", record, 28)
            packed = record[40 + name :]
            raw = zstandard.ZstdDecompressor().decompress(packed) if name else packed
            record = record[:28] + struct.pack("<LQ", 0, len(raw)) + raw
        content += bytes([data[place]]) + struct.pack("<Q", len(record)) + record
        place += 9 + length
    content += bytes([_DATA_END]) + struct.pack("<QL", 4, 0)
    content += bytes([_FOOTER]) + struct.pack("<QQQL", 20, 0, 0, 0) + _MAGIC
    return mended_mcap(bytes(content))


def mended_mcap(data: bytes) -> bytes:
    """MCAP file with the CRCs that its chunks should have, and none elsewhere."""
    content, place = bytearray(data), len(_MAGIC)
    while place + 9 <= len(content):
        opcode, length = content[place], int.from_bytes(content[place + 1 : place + 9], "little")
        begin, end = place + 9, place + 9 + length
        if end > len(content):
            break
        if opcode == _CHUNK and length >= 40:
            name = int.from_bytes(content[begin + 28 : begin + 32], "little")
            raw = content[begin + 40 + name : end]
            if begin + 40 + name <= end:
                struct.pack_into("<Q", content, begin + 16, len(raw) & (2**64 - 1))
                struct.pack_into("<L", content, begin + 24, crc32(raw))
                struct.pack_into("<Q", content, begin + 32 + name, len(raw))
        elif opcode == _DATA_END and length >= 4:
            struct.pack_into("<L", content, begin, 0)
        elif opcode == _FOOTER and length >= 20:
            struct.pack_into("<L", content, begin + 16, 0)
        place = end
    return bytes(content)
