# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Images, and what lies beside them, that claim more than there is or are of the wrong kind."""

import os
import pickle
import shutil
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

_STAMPS = [1_000_000_000 + k * 50_000_000 for k in range(6)]
_SENSOR = """%YAML:1.0
T_BS: {{data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}}
resolution: [64, 48]
intrinsics: [50, 50, 31.5, 23.5]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
"""
_CALIBRATION = "P0: 50 0 31.5 0 0 50 23.5 0 0 0 1 0\nP1: 50 0 31.5 -5 0 50 23.5 0 0 0 1 0\n"

Spoil = Callable[[Path], object]


def images(folder: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile images below a folder; yields what each is, and its path."""
    for number, (name, spoil) in enumerate(_spoilt_folders().items()):
        place = folder / f"images_{number}"
        _write_asl(place)
        spoil(place / "mav0")
        yield f"ASL: {name}", place
    for number, (name, spoil) in enumerate(_spoilt_sequences().items()):
        place = folder / f"sequence_{number}"
        _write_sequence(place)
        spoil(place)
        yield f"KITTI: {name}", place
    for number, (name, content) in enumerate(_pickles().items()):
        place = folder / f"course{number}_imgs.npy"
        place.write_bytes(content)
        shutil.copy(folder / "seed.npz", folder / f"course{number}.npz")
        yield f"course: {name}", place


def png_claiming(width: int, height: int) -> bytes:
    """Bytes of a PNG file with a few of its many pixels."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(99)))


def _spoilt_folders() -> dict[str, Spoil]:
    first = f"cam0/data/{_STAMPS[0]}.png"
    aliases = "a: &a [x, x]\n" + "".join(
        f"b{k}: &b{k} [*b{k - 1}, *b{k - 1}]\n" for k in range(1, 60)
    )
    return {
        "a PNG of 100000 x 100000": _put(first, png_claiming(100_000, 100_000)),
        "a later PNG of 30000 x 30000": _put(
            f"cam1/data/{_STAMPS[3]}.png", png_claiming(30_000, 30_000)
        ),
        "a JPEG of 65000 x 65000": _put(
            first, b"\xff\xd8\xff\xc0\x00\x11\x08" + struct.pack(">HH", 65_000, 65_000) + bytes(40)
        ),
        "a PGM of 1e9 x 1e9": _put(first, b"P5 999999999 999999999 255\n"),
        "a FIFO for an image": _replaced(first, os.mkfifo),
        "a device for an image": _replaced(first, lambda path: path.symlink_to("/dev/zero")),
        "a terabyte of zeros for an image": _put(first, b"\x89PNG\r\n\x1a\n", 1 << 40),
        "a device for a table": _replaced(
            "cam0/data.csv", lambda path: path.symlink_to("/dev/zero")
        ),
        "a terabyte of zeros for an IMU": _put("imu0/data.csv", b"", 1 << 40),
        "stamps of 4000 digits": _put("imu0/data.csv", 4000 * b"9" + b",1,2,3,4,5,6\n"),
        "a row of 60000 commas": _put("imu0/data.csv", 60_000 * b"," + b"\n"),
        "aliases of aliases": _put("cam0/sensor.yaml", aliases.encode()),
        "lists nested 100000 deep": _put("cam1/sensor.yaml", b"T_BS: " + 100_000 * b"["),
        "a focal length of 1e300": _put(
            "cam0/sensor.yaml", _SENSOR.format(x=0).replace("[50, 50", "[1e300, 1e300").encode()
        ),
    }


def _spoilt_sequences() -> dict[str, Spoil]:
    return {
        "no motion": lambda _: None,
        "names of 300 digits": _put(f"image_0/{'9' * 200}.png", b""),
        "a device for times": _replaced("times.txt", lambda path: path.symlink_to("/dev/zero")),
        "times of 1e300": _put("times.txt", b"1e300\n" * 9),
        "projections of infinity": _put("calib.txt", _CALIBRATION.replace("50", "inf").encode()),
    }


def _pickles() -> dict[str, bytes]:
    header = b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '|O', 'fortran_order': False, 'shape': (), }"
    header += b" " * (127 - len(header)) + b"\n"
    array = pickle.dumps({"cam_imgs_L": [np.zeros((48, 64), np.uint8)] * 2}, protocol=4)
    return {
        "an array of 2**60 bytes": header + b"\x80\x04\x8e" + struct.pack("<Q", 1 << 60) + b".",
        "a shape of 2**31 x 2**31": header
        + array.replace(b"K0K@", b"\x8a\x04\xff\xff\xff\x7f\x8a\x04\xff\xff\xff\x7f"),
        "lists nested a million deep": header + b"\x80\x04" + b"]" * 1_000_000 + b".",
        "tuples of tuples": header + b"\x80\x04)" + b"\x85" * 1_000_000 + b".",
        "a call": header + b"\x80\x04cposix\nsystem\n\x8c\x04true\x85R.",
        "nothing": header,
    }


def _put(name: str, content: bytes, size: int = 0) -> Spoil:
    """Put a file in a place, with zeros that take no room up to its size."""

    def put(folder: Path) -> None:
        with (folder / name).open("wb") as file:
            file.write(content)
            if size:
                file.truncate(size)

    return put


def _replaced(name: str, make: Spoil) -> Spoil:
    def replace(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        make(folder / name)

    return replace


def _write_asl(folder: Path) -> None:
    for name, x in (("cam0", 0.0), ("cam1", 0.1)):
        data = folder / "mav0" / name / "data"
        data.mkdir(parents=True)
        for stamp in _STAMPS:
            cv2.imwrite(str(data / f"{stamp}.png"), np.zeros((48, 64), np.uint8))
        (data.parent / "data.csv").write_text("".join(f"{s},{s}.png\n" for s in _STAMPS))
        (data.parent / "sensor.yaml").write_text(_SENSOR.format(x=x))
    imu = folder / "mav0" / "imu0"
    imu.mkdir()
    (imu / "data.csv").write_text("".join(f"{stamp},0,0,0,0,0,9.8\n" for stamp in _STAMPS))


def _write_sequence(folder: Path) -> None:
    for name in ("image_0", "image_1"):
        (folder / name).mkdir(parents=True)
        for k in range(len(_STAMPS)):
            cv2.imwrite(str(folder / name / f"{k:06d}.png"), np.zeros((48, 64), np.uint8))
    (folder / "calib.txt").write_text(_CALIBRATION)
