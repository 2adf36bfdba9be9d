# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from vislam_ros.errors import VislamError
from vislam_ros.frontend.grey import ENCODINGS, GreyStream, grey

# Red, green, blue of one colour, and its grey value by ITU-R BT.601.
COLOUR = np.array([200, 100, 50])
LUMINANCE = 0.299 * 200 + 0.587 * 100 + 0.114 * 50
MOSAICS = {"rggb": "rg gb", "bggr": "bg gr", "gbrg": "gb rg", "grbg": "gr bg"}


def encoded(encoding: str) -> NDArray[Any]:
    """Image (8, 10) of one colour."""
    bits = 16 if encoding.endswith("16") or encoding.startswith("16") else 8
    dtype, scale = (np.uint16, 257) if bits == 16 else (np.uint8, 1)
    kind = {"8UC1": "mono8", "16UC1": "mono16", "8UC3": "bgr8", "8UC4": "bgra8"}.get(
        encoding, encoding
    )
    kind = kind.removesuffix(str(bits))
    value = dict(zip("rgb", COLOUR.tolist(), strict=True)) | {"a": 77}
    if kind == "mono":
        image = np.full((8, 10), round(LUMINANCE))
    elif kind.startswith("bayer"):
        cell = [[value[name] for name in row] for row in MOSAICS[kind[6:]].split()]
        image = np.tile(cell, (4, 5))
    else:
        image = np.tile([value[name] for name in kind], (8, 10, 1))
    return (image * scale).astype(dtype)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_colour_has_one_grey_value_in_all_encodings(encoding: str) -> None:
    result = grey(encoded(encoding), encoding)
    assert result.shape == (8, 10)
    assert result.dtype == np.uint8
    # Away from the rim, whose colours are guessed.
    assert np.abs(result[2:-2, 2:-2] - LUMINANCE).max() <= 1.0


def test_a_grey_image_is_the_very_one() -> None:
    image = encoded("mono8")
    assert grey(image, "mono8") is image
    assert GreyStream().grey(image, "mono8") is image


@pytest.mark.parametrize(
    ("image", "encoding", "message"),
    [
        (np.zeros((4, 4), np.uint8), "yuv422", "image encoding 'yuv422'.*use one of mono8"),
        (np.zeros((4, 4), np.uint8), "", "image encoding ''"),
        (np.zeros((4, 4), np.uint8), "rgb8", r"\(4, 4\) of uint8, but rgb8 is \(H, W, 3\)"),
        (np.zeros((4, 4, 3), np.uint8), "mono8", r"mono8 is \(H, W\)"),
        (np.zeros((4, 4), np.uint8), "mono16", "of uint16"),
        (np.zeros((0, 4), np.uint8), "mono8", r"\(0, 4\)"),
        (np.zeros((2, 2), np.uint8), "bayer_rggb8", "too small"),
    ],
)
def test_what_is_no_image_is_told(image: NDArray[Any], encoding: str, message: str) -> None:
    with pytest.raises(VislamError, match=message):
        grey(image, encoding)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_images_of_all_depths_come_out_bright(bits: int) -> None:
    rng = np.random.default_rng(bits)
    image = rng.integers(0, 2**bits, (60, 80), dtype=np.uint16)
    result = GreyStream().grey(image, "mono16")
    assert np.ptp(result.astype(int)) > 100


def test_the_scale_of_a_stream_does_not_flicker() -> None:
    rng = np.random.default_rng(9)
    stream = GreyStream()
    # A thermal camera: a few hundred values of 65536, which come and go a little.
    mark = np.array([8000, 8100, 8200], np.uint16)
    marks = []
    for _ in range(20):
        low, high = rng.integers(7980, 8000), rng.integers(8250, 8300)
        image = rng.integers(low, high, (60, 80), dtype=np.uint16)
        image[0, :3] = mark
        marks.append(stream.grey(image, "mono16")[0, :3])
    assert np.ptp(marks[0].astype(int)) > 40
    for later in marks[1:]:
        assert_array_equal(later, marks[0])


def test_the_range_of_a_stream_grows_with_the_light_and_does_not_shrink() -> None:
    stream = GreyStream()
    dark = np.linspace(0, 500, 4800).reshape(60, 80).astype(np.uint16)
    first = stream.grey(dark, "mono16")
    assert stream.grey(dark * 20, "mono16").max() < 255
    then = stream.grey(dark, "mono16")
    assert then.max() < first.max() / 4
