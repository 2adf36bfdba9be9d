# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The size that is read off compressed frames is never less than what they unpack to."""

import io
from collections.abc import Callable

import lz4.frame
import numpy as np
import pytest
import zstandard

from vislam_ros.data.bags.compressed_size import largest_size

CONTENTS = {
    "nothing": b"",
    "zeros": bytes(3_000_000),
    "noise": np.random.default_rng(0).bytes(700_000),
    "text": b"features and twists " * 20_000,
}
COMPRESSORS: dict[str, tuple[str, Callable[[bytes], bytes]]] = {
    "zstd": ("zstd", zstandard.ZstdCompressor().compress),
    "zstd without its size": (
        "zstd",
        zstandard.ZstdCompressor(write_content_size=False, write_checksum=True).compress,
    ),
    "zstd in two frames": (
        "zstd",
        lambda data: b"".join(
            zstandard.ZstdCompressor().compress(part) for part in (data[:1000], data[1000:])
        ),
    ),
    "lz4": ("lz4", lz4.frame.compress),
    "lz4 with its size": ("lz4", lambda data: lz4.frame.compress(data, store_size=True)),
    "lz4 with checksums": (
        "lz4",
        lambda data: lz4.frame.compress(
            data, store_size=False, content_checksum=True, block_checksum=True
        ),
    ),
}


def size(packed: bytes, compression: str) -> int | None:
    return largest_size(io.BytesIO(packed), len(packed), compression)


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("compressor", COMPRESSORS)
def test_no_frame_unpacks_to_more(content: str, compressor: str) -> None:
    data = CONTENTS[content]
    compression, compress = COMPRESSORS[compressor]
    largest = size(compress(data), compression)
    assert largest is not None
    # A block counts as whole, of 128 kB or 4 MB.
    assert len(data) <= largest <= len(data) + (4 << 20)


def test_a_frame_that_claims_its_size_counts_as_what_it_claims() -> None:
    packed = zstandard.ZstdCompressor().compress(bytes(1 << 28))
    assert len(packed) < 20_000
    assert size(packed, "zstd") == 1 << 28


def test_what_is_not_compressed_is_as_large_as_it_is_and_the_unknown_is_not_known() -> None:
    assert size(b"12345", "") == 5
    assert size(b"12345", "xz") is None
