# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Image files of each kind are read as they are; false claims are refused, not believed."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from vislam_ros.data.images.image_file import FilePairs, image_file_size, read_image
from vislam_ros.errors import VislamError

WIDTH, HEIGHT = 37, 23


def noise(*channels: int, dtype: type = np.uint8) -> np.ndarray:
    high = np.iinfo(dtype).max
    return np.random.default_rng(1).integers(0, high, (HEIGHT, WIDTH, *channels), dtype=dtype)


LOSSLESS = {
    "grey.png": (noise(), "mono8"),
    "deep.png": (noise(dtype=np.uint16), "mono16"),
    "colour.png": (noise(3), "bgr8"),
    "clear.png": (noise(4), "bgra8"),
    "grey.pgm": (noise(), "mono8"),
    "colour.ppm": (noise(3), "bgr8"),
    "grey.bmp": (noise(), "mono8"),
}


@pytest.mark.parametrize("name", LOSSLESS)
def test_lossless_files_come_bit_for_bit(name: str, tmp_path: Path) -> None:
    pixels, encoding = LOSSLESS[name]
    path = tmp_path / name
    assert cv2.imwrite(str(path), pixels)
    found = read_image(path, (WIDTH, HEIGHT))
    assert found.encoding == encoding
    np.testing.assert_array_equal(found.pixels, pixels)
    assert image_file_size(path) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("progressive", [0, 1])
def test_a_jpeg_is_read_with_its_size(progressive: int, tmp_path: Path) -> None:
    path = tmp_path / "image.jpg"
    grey = cv2.GaussianBlur(noise(), (0, 0), 4)
    assert cv2.imwrite(str(path), grey, [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])
    found = read_image(path, (WIDTH, HEIGHT))
    assert found.encoding == "mono8"
    np.testing.assert_allclose(found.pixels.astype(int), grey.astype(int), atol=12)


def png_claiming(width: int, height: int) -> bytes:
    def chunk(name: bytes, data: bytes) -> bytes:
        checksum = zlib.crc32(name + data)
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", checksum)

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + data


BAD = {
    "a claim of ten thousand megapixels": (png_claiming(100_000, 100_000), "claims 100000 x 1000"),
    "no pixels": (png_claiming(0, 10), "claims 0 x 10 pixels"),
    "cut off": (png_claiming(300, 200), "cut off or damaged"),
    "netpbm of ten digits": (b"P5 999999999 999999999 255\n", "claims 999999999 x 999999999"),
    "a text": (b"no image at all", "is no PNG, JPEG, BMP, PGM or PPM image"),
    "nothing": (b"", "is no PNG, JPEG, BMP, PGM or PPM image"),
    "a JPEG without a frame": (b"\xff\xd8\xff\xe0\x00\x04ab\xff\xd9", "is no PNG, JPEG"),
}


@pytest.mark.parametrize(("data", "reason"), BAD.values(), ids=BAD)
def test_what_is_no_image_is_refused_without_room_for_it(
    data: bytes, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "image.png"
    path.write_bytes(data)
    tracemalloc.start()
    with pytest.raises(VislamError, match=reason) as caught:
        read_image(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert peak < 4 << 20


@pytest.mark.parametrize("damage", ["cut off", "zeros", "a bit"])
def test_a_damaged_png_is_told_in_one_line_and_by_nobody_else(
    damage: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.png"
    pixels = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    assert cv2.imwrite(str(path), pixels)
    data = path.read_bytes()
    half = len(data) // 2
    damaged = {
        "cut off": data[:half],
        "zeros": data[:half] + bytes(half),
        "a bit": data[:half] + bytes([data[half] ^ 1]) + data[half + 1 :],
    }
    path.write_bytes(damaged[damage])
    with pytest.raises(VislamError, match="this image is cut off or damaged"):
        read_image(path)
    assert capfd.readouterr() == ("", "")


def test_what_follows_a_png_and_what_is_said_of_it_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    pixels = np.full((HEIGHT, WIDTH), 7, np.uint8)
    assert cv2.imwrite(str(path), pixels)
    data, words = path.read_bytes(), b"tEXtComment\0by hand"
    # Behind the signature and the header; with a checksum that is wrong.
    said = struct.pack(">I", len(words) - 4) + words + bytes(4)
    path.write_bytes(data[:33] + said + data[33:] + b"more")
    np.testing.assert_array_equal(read_image(path).pixels, pixels)


def test_an_image_of_another_size_than_the_first_is_refused(tmp_path: Path) -> None:
    files = []
    for k, width in enumerate((WIDTH, WIDTH + 1)):
        pair = tmp_path / f"left{k}.png", tmp_path / f"right{k}.png"
        for path in pair:
            assert cv2.imwrite(str(path), np.zeros((HEIGHT, width), np.uint8))
        files.append(pair)
    with pytest.raises(VislamError, match=r"left1\.png: has 38 x 23 pixels, and its camera 37 x"):
        list(FilePairs(files)([0, 1]))
