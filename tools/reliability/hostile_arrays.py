# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Datasets that claim more than they hold, or hold what cannot be: archives and pickles."""

import io
import struct
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]

_ABSURD: Mapping[str, Any] = {
    "velocity of 1e30": ("linear_velocity", 1e30),
    "angular velocity of 1e200": ("angular_velocity", 1e200),
    "velocity of infinity": ("linear_velocity", np.inf),
    "focal length of 1e300": ("K", np.diag([1e300, 1e300, 1.0])),
    "focal length of 1e-300": ("K", np.diag([1e-300, 1e-300, 1.0])),
    "baseline of 1e-300": ("b", np.array(1e-300)),
    "baseline of 1e300": ("b", np.array(1e300)),
    "camera 1e200 m away": ("imu_T_cam", np.diag([1.0, 1.0, 1.0, 1.0]) + 1e200 * np.eye(4, k=3)),
    "truth 1e200 m away": ("ground_truth_T_world_body", 1e200),
    "stamps in nanoseconds": ("time_stamps", 1.7e18),
}


def archives(folder: Path, arrays: Arrays) -> Iterator[tuple[str, Path]]:
    """Write hostile ``.npz`` files below a folder; yields what each is, and its path."""
    for name, (key, value) in _ABSURD.items():
        whole = value if isinstance(value, np.ndarray) else np.full_like(arrays[key], value)
        yield name, _saved(folder / f"{len(name)}_{key}.npz", {**arrays, key: whole})
    stamps = arrays["time_stamps"].copy()
    stamps[0, 3:] += 365.0 * 86400.0
    yield "gap of a year", _saved(folder / "gap.npz", {**arrays, "time_stamps": stamps})
    for kind, dtype in (("text", "U8"), ("complex numbers", "c16"), ("dates", "M8[s]")):
        changed = {**arrays, "b": np.zeros(1, dtype=dtype)}
        yield f"baseline of {kind}", _saved(folder / f"{dtype[0]}.npz", changed)
    for name, shape in (("tracks", (4, 1 << 40, 12)), ("steps", (1, 1 << 50))):
        key = "features" if name == "tracks" else "time_stamps"
        yield f"header that claims {name}", _claiming(folder / f"{name}.npz", arrays, key, shape)
    zeros = {**arrays, "features": np.zeros((4, 100_000, arrays["time_stamps"].size))}
    yield "archive of zeros", _saved(folder / "zeros.npz", zeros, packed=True)
    yield "stamps of zeros", _zero_member(folder / "zero_stamps.npz", arrays)
    yield "archive that lies of a size", _lying(folder / "lying.npz", arrays)
    cut = (folder / "seed.npz").read_bytes()[:-200]
    yield "cut off", _written(folder / "cut.npz", cut)
    yield "empty", _written(folder / "empty.npz", b"")
    yield "text", _written(folder / "text.npz", b"no archive\n")


def pickles(folder: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile ``.npy`` files below a folder; yields what each is, and its path."""
    programs = {
        "bytes of a claimed length": b"\x8e" + struct.pack("<Q", 20 << 30) + b"x",
        "bytearray of a claimed length": b"\x96" + struct.pack("<Q", 20 << 30) + b"x",
        "frame of a claimed length": b"\x95" + struct.pack("<Q", 20 << 30) + b"}.",
        "integer of a claimed length": b"\x8b" + struct.pack("<i", 1 << 30) + b"x",
        "place in the memo far ahead": b"}r" + struct.pack("<I", 1 << 31) + b".",
        "bytearrays by number": b"("
        + 50 * (b"cbuiltins\nbytearray\n" + b"J\xff\xff\xff\x7f\x85R")
        + b"t.",
        "copies of copies": b"C\xff"
        + 255 * b"x"
        + b"\x94"
        + 300_00 * b"cbuiltins\nbytearray\nh\x00\x85R0"
        + b"}.",
        "tuples of tuples": b"K\x01\x85\x94"
        + b"".join(b"h" + bytes([k]) + b"\x86\x94" for k in range(60))
        + b"K\x01s.",
        "lists of lists": b"]\x94"
        + b"".join(b"]\x94(" + 9 * (b"h" + bytes([k])) + b"e" for k in range(60))
        + b".",
        "tuples nested 100000 deep": b"}K\x01" + 100_000 * b"\x85" + b"K\x02s.",
        "lists nested 100000 deep": b"}U\x01b" + 100_000 * b"]" + 99_999 * b"a" + b"s.",
        "a call of the system": b"cos\nsystem\nU\x04true\x85R.",
        "a type of unpickled text": b"cnumpy\ndtype\nU\xff" + 255 * b"i," + b"\x85R.",
        "cut off": b"}U\x01b",
    }
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|O", "fortran_order": False, "shape": ()}
    )
    for number, (name, program) in enumerate(programs.items()):
        content = header.getvalue() + b"\x80\x04" + program
        yield f"pickle: {name}", _written(folder / f"pickle_{number}.npy", content)


def _saved(path: Path, arrays: Arrays, *, packed: bool = False) -> Path:
    method = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, array in arrays.items():
            archive.writestr(f"{name}.npy", _member(array))
    return path


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _member(array: NDArray[Any]) -> bytes:
    content = io.BytesIO()
    np.save(content, array)
    return content.getvalue()


def _claiming(path: Path, arrays: Arrays, key: str, shape: tuple[int, ...]) -> Path:
    """Archive of which one header speaks of more numbers than are there."""
    header = io.BytesIO()
    content = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, content)
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            member = header.getvalue() + b"x" * 64 if name == key else _member(array)
            archive.writestr(f"{name}.npy", member)
    return path


def _zero_member(path: Path, arrays: Arrays) -> Path:
    """Archive whose stamps are gigabytes of zeros."""
    header = io.BytesIO()
    content = {"descr": "<f8", "fortran_order": False, "shape": (1, 1 << 24)}
    np.lib.format.write_array_header_1_0(header, content)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if name != "time_stamps":
                    member.write(_member(array))
                    continue
                member.write(header.getvalue())
                for _ in range(128):
                    member.write(bytes(1 << 20))
    return path


def _lying(path: Path, arrays: Arrays) -> Path:
    """Archive whose directory says that its members are gigabytes."""
    _saved(path, arrays)
    content = bytearray(path.read_bytes())
    place = content.find(b"PK\x01\x02")
    while place >= 0:
        struct.pack_into("<L", content, place + 24, 0xFFFFFF00)
        place = content.find(b"PK\x01\x02", place + 4)
    return _written(path, bytes(content))
