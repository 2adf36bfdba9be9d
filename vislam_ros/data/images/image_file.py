# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Image files: PNG, JPEG, BMP, PGM and PPM, of 8 or 16 bits.

A few bytes can claim an image of gigabytes. Its size is read in its header, and held against the
camera's, before anything of that size is made.
"""

import contextlib
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from vislam_ros.core.geometry.stereo_rig import RawCamera
from vislam_ros.data.files.inputs import open_input
from vislam_ros.data.images.stereo_images import RawImage
from vislam_ros.errors import VislamError

Size = tuple[int, int]

#: No camera of a vehicle has more pixels.
LARGEST_IMAGE = 1 << 26
# A file of an image is hardly larger than its pixels, of four times 16 bits at most [bytes].
_LARGEST_FILE = 8 * LARGEST_IMAGE

_WHAT = "this image"
_PNG = b"\x89PNG\r\n\x1a\n"
_NETPBM = re.compile(rb"P[2356](?:\s*#[^\n]*\n|\s)+(\d{1,9})(?:\s*#[^\n]*\n|\s)+(\d{1,9})\s")
# Of a JPEG's markers those that begin a frame, and those without a length.
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_BARE = frozenset({0x01, *range(0xD0, 0xD9)})
_ENCODINGS = {
    ("uint8", 1): "mono8",
    ("uint16", 1): "mono16",
    ("uint8", 3): "bgr8",
    ("uint8", 4): "bgra8",
}


class FilePairs:
    """Reads pairs of files, those of a side all of one size.

    Parameters
    ----------
    files : sequence of (Path, Path)
        Left and right, one pair at least.

    Attributes
    ----------
    sizes : list of (int, int)
        Width and height of the left images and of the right ones, pixels: those of the first.
    """

    def __init__(self, files: Sequence[tuple[Path, Path]]):
        self._files = files
        self.sizes = [image_file_size(file) for file in files[0]]

    def sized(self, left: RawCamera, right: RawCamera) -> tuple[RawCamera, RawCamera]:
        """Both cameras with the images' sizes, which calibrations need not tell.

        Raises
        ------
        VislamError
            Where a calibration tells another size.
        """
        for camera, size, file in zip((left, right), self.sizes, self._files[0], strict=True):
            if all(camera.image_size) and camera.image_size != size:
                raise _wrong_size(str(file), size, camera.image_size)
        return (
            replace(left, image_size=self.sizes[0]),
            replace(right, image_size=self.sizes[1]),
        )

    def __call__(self, places: Sequence[int]) -> Iterator[tuple[RawImage, RawImage]]:
        """Read the pairs at some places, one after the other."""
        for place in places:
            left, right = map(read_image, self._files[place], self.sizes)
            yield left, right


def read_image(path: Path, size: Size | None = None) -> RawImage:
    """Read a file of an image.

    Parameters
    ----------
    path : Path
    size : tuple of int, (2,), optional
        Width and height that it must have, pixels.

    Raises
    ------
    VislamError
        Where it cannot be read, is of another kind or size, or is damaged.
    """
    return decoded(_content(path), str(path), size)


def image_file_size(path: Path) -> Size:
    """Width and height of an image file, pixels, from its header."""
    return size_in_header(_content(path), str(path))


def decoded(data: bytes, where: str, size: Size | None = None) -> RawImage:
    """Image of a file's bytes; errors begin with ``where`` (see :func:`read_image`)."""
    width, height = size_in_header(data, where)
    if size is not None and (width, height) != size:
        raise _wrong_size(where, (width, height), size)
    # It takes a while to import, which those that only look for a format need not wait for.
    import cv2

    pixels = None
    # The decoder writes lines of its own about damage that the checksums of a PNG tell.
    if not data.startswith(_PNG) or _is_whole_png(data):
        with contextlib.suppress(cv2.error):
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.shape[:2] != (height, width):
        raise VislamError(f"{where}: this image is cut off or damaged: copy it anew, or remove it")
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    encoding = _ENCODINGS.get((pixels.dtype.name, channels))
    if encoding is None:
        raise VislamError(
            f"{where}: has {channels} channels of {pixels.dtype}: save it in 8 bits, or in grey"
        )
    return RawImage(pixels, encoding)


def size_in_header(data: bytes, where: str) -> Size:
    """Width and height that a file's bytes claim, pixels.

    Raises
    ------
    VislamError
        That begins with ``where``: it is no such image, or claims more than any camera has.
    """
    size = _claimed_size(data)
    if size is None:
        raise VislamError(f"{where}: is no PNG, JPEG, BMP, PGM or PPM image, or is cut off")
    width, height = size
    if width < 1 or height < 1 or width * height > LARGEST_IMAGE:
        raise VislamError(f"{where}: claims {width} x {height} pixels, which no camera has")
    return size


def _wrong_size(where: str, size: Size, wanted: Size) -> VislamError:
    return VislamError(
        f"{where}: has {size[0]} x {size[1]} pixels, and its camera {wanted[0]} x {wanted[1]}: "
        "calibrate the camera for these images"
    )


def _content(path: Path) -> bytes:
    with open_input(path, _WHAT) as file:
        # A read of a length makes room for it first, so it must not be the largest there may be.
        length = file.seek(0, 2)
        if length > _LARGEST_FILE:
            raise VislamError(f"{path}: cannot read {_WHAT}: it is larger than any camera's")
        file.seek(0)
        return file.read(length)


def _claimed_size(data: bytes) -> Size | None:
    if data.startswith(_PNG) and len(data) >= 24:
        return _big(data, 16, 4), _big(data, 20, 4)
    if data.startswith(b"\xff\xd8"):
        return _jpeg_size(data)
    if data.startswith(b"BM") and len(data) >= 26:
        height = int.from_bytes(data[22:26], "little", signed=True)
        return int.from_bytes(data[18:22], "little"), abs(height)
    if match := _NETPBM.match(data[:4096]):
        return int(match[1]), int(match[2])
    return None


def _is_whole_png(data: bytes) -> bool:
    """Whether all chunks to the last are there, and their checksums right."""
    place = len(_PNG)
    while place + 12 <= len(data):
        end = place + 12 + _big(data, place, 4)
        kind = data[place + 4 : place + 8]
        # Of a small first letter are those that hold no pixels.
        is_needed = kind[:1].isupper()
        if end > len(data) or (
            is_needed and zlib.crc32(data[place + 4 : end - 4]) != _big(data, end - 4, 4)
        ):
            return False
        if kind == b"IEND":
            return True
        place = end
    return False


def _jpeg_size(data: bytes) -> Size | None:
    place = 2
    while place + 9 <= len(data):
        if data[place] != 0xFF:
            return None
        marker = data[place + 1]
        if marker in _FRAMES:
            return _big(data, place + 7, 2), _big(data, place + 5, 2)
        if marker == 0xFF:  # padding
            place += 1
        elif marker in _BARE:
            place += 2
        else:
            place += 2 + max(_big(data, place + 2, 2), 2)
    return None


def _big(data: bytes, place: int, size: int) -> int:
    return int.from_bytes(data[place : place + size], "big")
