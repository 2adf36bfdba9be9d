# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A pickle gives arrays and plain containers, and never runs anything."""

import contextlib
import io
import os
import pickle
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from numpy import ndarray
from numpy.typing import NDArray

from vislam_ros.data.datasets.arrays.restricted_pickle import load_plain
from vislam_ros.errors import VislamError

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)


def read(data: bytes) -> Any:
    return load_plain(io.BytesIO(data), "drive.npy")


class Calls:
    """Pickles as a call of ``function(*arguments)``."""

    def __init__(self, function: Callable[..., Any] | type[ndarray], *arguments: Any) -> None:
        self.reduced = (function, arguments)

    def __reduce__(self) -> tuple[Callable[..., Any] | type[ndarray], tuple[Any, ...]]:
        return self.reduced


@pytest.mark.parametrize("protocol", PROTOCOLS)
@given(
    array=st_numpy.arrays(
        st_numpy.floating_dtypes(sizes=(32, 64)) | st_numpy.integer_dtypes(),
        st_numpy.array_shapes(min_dims=0, max_dims=3, min_side=0),
    ),
    transposed=st.booleans(),
)
@settings(deadline=None, max_examples=30)
def test_an_array_comes_back_as_it_was(
    protocol: int, array: NDArray[Any], transposed: bool
) -> None:
    array = array.T if transposed else array
    read_back = read(pickle.dumps({"K": array}, protocol=protocol))["K"]
    assert read_back.dtype == array.dtype
    np.testing.assert_array_equal(read_back, array)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_numpy_saves_comes_back(protocol: int) -> None:
    content = {"K": np.eye(3), "b": np.float64(0.5), "names": np.array(["a", "bc"])}
    saved = pickle.dumps(np.array(content, dtype=object), protocol=protocol)
    read_back = read(saved)
    assert list(read_back) == list(content)
    for name, value in content.items():
        np.testing.assert_array_equal(read_back[name], value)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_plain_containers_come_back(protocol: int) -> None:
    content = {
        "a": [1, 2.5, None, True],
        "b": ("x", b"y"),
        "c": {1, 2},
        "d": OrderedDict(z=1),
        "e": frozenset([3]),
        "f": bytearray(b"z"),
        "g": 1 + 2j,
    }
    assert read(pickle.dumps(content, protocol=protocol)) == content


def test_both_names_of_numpys_core_are_known() -> None:
    saved = pickle.dumps(np.arange(3.0), protocol=0)
    old = saved.replace(b"numpy._core.", b"numpy.core.")
    new = saved.replace(b"numpy.core.", b"numpy._core.")
    assert old != new
    np.testing.assert_array_equal(read(old), read(new))


def test_a_pickle_of_python_2_is_read() -> None:
    # What Python 2 wrote for {'b': numpy.array([0.5])}: names and bytes are both of type str.
    saved = (
        b"\x80\x02}U\x01bcnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b"
        b"\x87R(K\x01K\x01\x85cnumpy\ndtype\nU\x02f8K\x00K\x01\x87R(K\x03U\x01<NNNJ\xff\xff\xff"
        b"\xffJ\xff\xff\xff\xffK\x00tb\x89U\x08\x00\x00\x00\x00\x00\x00\xe0?tbs."
    )
    np.testing.assert_array_equal(read(saved)["b"], [0.5])


def test_dtypes_come_back() -> None:
    assert read(pickle.dumps({"a": np.dtype(">f4")})) == {"a": np.dtype(">f4")}


def test_big_endian_arrays_keep_their_values() -> None:
    array = np.array([1.0, 2.0], dtype=">f8")
    np.testing.assert_array_equal(read(pickle.dumps(array)), [1.0, 2.0])


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("wrap", [lambda call: call, lambda call: {"K": np.eye(3), "b": [call]}])
@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda mark: Calls(os.system, f"touch {mark}"), "system"),
        (lambda mark: Calls(eval, f"open({str(mark)!r}, 'w')"), "eval"),
        (lambda mark: Calls(Path.touch, mark), "pathlib|getattr"),
        (lambda mark: Calls(np.load, str(mark)), "numpy"),
        (lambda mark: Calls(getattr, "text", "upper"), "getattr"),
    ],
    ids=["os.system", "eval", "Path.touch", "numpy.load", "getattr"],
)
def test_a_pickle_that_calls_something_is_refused_and_nothing_runs(
    tmp_path: Path, protocol: int, wrap: Callable[..., Any], call: Callable[..., Any], named: str
) -> None:
    mark = tmp_path / "ran"
    data = pickle.dumps(wrap(call(mark)), protocol=protocol)
    with pytest.raises(VislamError, match=named) as caught:
        read(data)
    assert str(caught.value).startswith("drive.npy: holds ")
    assert "\n" not in str(caught.value)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (np.array([1, "two"], dtype=object), "array of objects"),
        ({"K": np.array([[1, None]], dtype=object)}, "array of objects"),
        (np.zeros(2, dtype=[("a", "f8")]), "dtype"),
        (np.array(["2020-01-01"], dtype="datetime64[D]"), "dtype"),
        (np.ma.masked_array([1.0], mask=[True]), "numpy.ma"),
        (Calls(np.ndarray, (2,)), "cut off or damaged"),
    ],
    ids=["objects", "nested objects", "fields", "dates", "masked", "ndarray"],
)
def test_arrays_that_are_not_plain_are_refused(value: Any, named: str) -> None:
    with pytest.raises(VislamError, match=named):
        read(pickle.dumps(value))


def test_a_refused_name_cannot_break_the_line() -> None:
    data = b"\x80\x04\x8c\x03a\nb\x8c\x03c\nd\x93."
    with pytest.raises(VislamError) as caught:
        read(data)
    assert "\n" not in str(caught.value)


def test_a_pickle_cannot_alter_the_functions_it_may_call() -> None:
    # BUILD with attributes on numpy._core.multiarray.scalar.
    data = (
        b"\x80\x04\x8c\x16numpy._core.multiarray\x8c\x06scalar\x93N}\x8c\x08functionK\x01s\x86b."
    )
    with pytest.raises(VislamError, match="damaged"):
        read(data)
    assert read(pickle.dumps(np.float64(2.0))) == 2.0


def test_an_array_with_too_few_bytes_is_refused() -> None:
    data = pickle.dumps(np.arange(4.0), protocol=2).replace(b"K\x04\x85", b"K\x09\x85")
    with pytest.raises(VislamError, match="damaged"):
        read(data)


@given(cut=st.integers(0, 200), flip=st.integers(0, 255))
@settings(deadline=None, max_examples=200)
def test_damage_raises_no_other_error(cut: int, flip: int) -> None:
    data = bytearray(pickle.dumps({"K": np.eye(2), "b": np.float64(1.0)}, protocol=4))
    data[cut % len(data)] ^= flip
    with contextlib.suppress(VislamError):
        read(bytes(data))


@given(length=st.integers(0, 100))
@settings(deadline=None, max_examples=50)
def test_a_cut_off_pickle_is_refused(length: int) -> None:
    data = pickle.dumps({"K": np.eye(2)}, protocol=4)
    with pytest.raises(VislamError, match="cut off or damaged"):
        read(data[:length])
