# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Large arrays of a pickle are read from the file in pieces, and are what they were."""

import io
import pickle
import subprocess
import sys

import numpy as np
import pytest

from vislam_ros.data.datasets.arrays.array_stream import CHUNK_BYTES, open_arrays
from vislam_ros.data.datasets.arrays.pickle_limits import LARGE
from vislam_ros.data.datasets.arrays.restricted_pickle import load_plain
from vislam_ros.data.datasets.arrays.stored_array import StoredArray
from vislam_ros.errors import VislamError

PROTOCOLS = range(3, pickle.HIGHEST_PROTOCOL + 1)  # earlier ones write bytes as text


def left_in_file(content, protocol=4):
    stream = io.BytesIO(b"header" + pickle.dumps(content, protocol=protocol))
    stream.seek(6)
    return load_plain(stream, "drive.npy", leave_large=True)


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f8", ">f4", "<i2"])
def test_a_large_array_stays_and_a_small_one_is_held(protocol, order, dtype):
    array = np.asarray(np.arange(3 * 5 * LARGE // 8).reshape(3, 5, -1) % 1000, dtype, order)
    small = np.eye(3)
    content = left_in_file({"features": array, "again": array, "K": small}, protocol)
    np.testing.assert_array_equal(content["K"], small)
    for name in ("features", "again"):
        stored = content[name]
        assert isinstance(stored, StoredArray)
        assert (stored.shape, stored.dtype) == (array.shape, array.dtype)
        assert stored.fortran_order is (order == "F")
        assert stored.stored.read(0, len(stored.stored)) == array.tobytes("A")


@pytest.mark.parametrize(("size", "stays"), [(LARGE - 1, False), (LARGE, True)])
def test_what_is_large_is_told_by_its_bytes(size, stays):
    content = left_in_file({"a": np.zeros(size, np.uint8)})
    assert isinstance(content["a"], StoredArray) is stays


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_cannot_stay_is_held(protocol):
    permuted = np.arange(4.0 * LARGE).reshape(2, 4, -1).transpose(1, 2, 0)
    content = left_in_file({"permuted": permuted, "bytes": b"x" * LARGE}, protocol)
    assert content["bytes"] == b"x" * LARGE
    held = content["permuted"]
    if isinstance(held, StoredArray):  # protocols before 5 copy such an array into C order
        held = np.frombuffer(held.stored.whole, held.dtype).reshape(held.shape)
    np.testing.assert_array_equal(held, permuted)


def test_bytes_that_are_asked_for_often_are_held_once():
    big = b"x" * LARGE
    saved = pickle.dumps({"a": big, "b": big}, protocol=4)
    stream = io.BytesIO(saved)
    content = load_plain(stream, "drive.npy", leave_large=True)
    assert content["a"] is content["b"]


def test_a_pickle_cannot_ask_for_bytes_by_their_number():
    saved = pickle.dumps({"a": np.zeros(LARGE)}, protocol=4)
    assert saved.endswith(b"s.")
    # BINPERSID: what stands for large bytes, asked for by the pickle itself.
    stream = io.BytesIO(saved[:-2] + b"\x8c\x01bK\x00Qss.")
    with pytest.raises(VislamError, match="damaged"):
        load_plain(stream, "drive.npy", leave_large=True)


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_stream_gives_the_numbers_in_pieces_and_again_when_opened_again(tmp_path, order):
    array = np.asarray(np.random.default_rng(0).normal(size=(4, 300, 1000)), order=order)
    np.save(tmp_path / "drive.npy", np.array({"features": array, "b": 0.5}, dtype=object))
    with open_arrays(tmp_path / "drive.npy") as arrays:
        one, other = arrays["features"](), arrays["features"]()
        pieces = [(a, b) for a, b in zip(one.chunks, other.chunks, strict=True)]
        assert len(pieces) == -(-array.nbytes // CHUNK_BYTES) > 1
        for of_both in zip(*pieces, strict=True):
            np.testing.assert_array_equal(
                np.concatenate(of_both).reshape(array.shape, order=order), array
            )
        np.testing.assert_array_equal(arrays["features"]().array(), array)
        assert arrays["b"]().array() == 0.5


def test_a_large_array_that_is_no_numbers_is_named(tmp_path):
    text = np.array(["word"] * LARGE)
    np.save(tmp_path / "drive.npy", np.array({"features": text}, dtype=object))
    with (
        open_arrays(tmp_path / "drive.npy") as arrays,
        pytest.raises(VislamError, match="features: holds an array of <U4, not"),
    ):
        arrays["features"]()


def test_a_file_is_read_in_a_fraction_of_its_size(tmp_path):
    path = tmp_path / "drive.npy"
    features = np.full((4, 500, 4000), -1.0)
    features[:, :, 7] = 1.0
    np.save(path, np.array({"features": features}, dtype=object))
    # ru_maxrss would count the parent before exec, too.
    program = (
        "import sys; from pathlib import Path\n"
        "from vislam_ros.data.datasets.arrays.array_stream import open_arrays\n"
        "from vislam_ros.data.datasets.sparse_features import gather_observations\n"
        "def kilobytes(name):\n"
        "    lines = Path('/proc/self/status').read_text().splitlines()\n"
        "    return next(line.split()[1] for line in lines if line.startswith(name))\n"
        "before = kilobytes('VmRSS')\n"
        "with open_arrays(Path(sys.argv[1])) as arrays:\n"
        "    features = gather_observations(arrays['features'])\n"
        "print(len(features.ids), before, kilobytes('VmHWM'))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", program, path],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    observations, before, peak = map(int, result.stdout.split())
    assert observations == 500
    assert peak - before < features.nbytes / 1024 / 2
