# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How large compressed data can become, read off their frames without unpacking them."""

from typing import BinaryIO

_ZSTD, _LZ4 = 0xFD2FB528, 0x184D2204
_SKIPPABLE, _SKIPPABLE_MASK = 0x184D2A50, 0xFFFFFFF0
# A zstd block unpacks to no more (RFC 8878, 3.1.1.2.4) [bytes].
_LARGEST_ZSTD_BLOCK = 1 << 17


def largest_size(file: BinaryIO, end: int, compression: str) -> int | None:
    """Most bytes that the frames from here to ``end`` unpack to; None where that is not known.

    Parameters
    ----------
    file : binary file
        At the first frame.
    end : int
        Place behind the last one.
    compression : str
        As MCAP names it: "zstd", "lz4", or "" for none.
    """
    if compression == "":
        return end - file.tell()
    if compression not in ("zstd", "lz4"):
        return None
    total = 0
    while end - file.tell() >= 4:
        magic = _number(file, 4)
        if magic & _SKIPPABLE_MASK == _SKIPPABLE:
            file.seek(_number(file, 4), 1)
        elif magic == _ZSTD and compression == "zstd":
            total += _zstd_frame(file, end)
        elif magic == _LZ4 and compression == "lz4":
            total += _lz4_frame(file, end)
        else:
            break
    return total


def _zstd_frame(file: BinaryIO, end: int) -> int:
    """Pass over a frame (RFC 8878, 3.1.1); its blocks are what is unpacked, whatever it claims."""
    descriptor = _number(file, 1)
    single_segment, has_checksum = bool(descriptor & 0x20), bool(descriptor & 0x04)
    dictionary = (0, 1, 2, 4)[descriptor & 3]
    content = (1 if single_segment else 0, 2, 4, 8)[descriptor >> 6]
    if not single_segment:
        _number(file, 1)
    _number(file, dictionary)
    # The reader makes room for what the frame claims, before it looks at a block.
    claimed = _number(file, content) + (256 if content == 2 else 0)
    blocks = 0
    is_last = False
    while not is_last and file.tell() < end:
        header = _number(file, 3)
        is_last, kind, size = bool(header & 1), header >> 1 & 3, header >> 3
        blocks += min(size, _LARGEST_ZSTD_BLOCK) if kind < 2 else _LARGEST_ZSTD_BLOCK
        file.seek(1 if kind == 1 else size, 1)
    if has_checksum:
        file.seek(4, 1)
    return max(claimed, blocks) if content == 0 else claimed


def _lz4_frame(file: BinaryIO, end: int) -> int:
    """Pass over a frame (LZ4 frame format 1.6.3)."""
    flags, descriptor = _number(file, 1), _number(file, 1)
    largest_block = 1 << 8 + 2 * (descriptor >> 4 & 7)
    claimed = _number(file, 8) if flags & 0x08 else 0
    file.seek((4 if flags & 0x01 else 0) + 1, 1)
    blocks = 0
    while file.tell() < end and (size := _number(file, 4)):
        blocks += largest_block
        file.seek((size & 0x7FFFFFFF) + (4 if flags & 0x10 else 0), 1)
    if flags & 0x04:
        file.seek(4, 1)
    return max(claimed, blocks)


def _number(file: BinaryIO, size: int) -> int:
    return int.from_bytes(file.read(size), "little")
