# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Regular files are read, and never more of one than is wanted."""

import os
import socket
from pathlib import Path

import pytest

from vislam_ros.data.files.inputs import (
    LARGEST_TEXT,
    check_regular,
    open_input,
    read_lines,
    read_text,
)
from vislam_ros.errors import VislamError


@pytest.mark.parametrize("kind", ["FIFO", "device", "socket", "directory"])
@pytest.mark.parametrize("linked", [False, True])
def test_what_is_no_file_is_refused_before_it_is_opened(
    tmp_path: Path, kind: str, linked: bool
) -> None:
    path = tmp_path / "a"
    if kind == "FIFO":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "directory":
        path.mkdir()
    else:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(str(path))
    if linked:
        (tmp_path / "link").symlink_to(path)
        path = tmp_path / "link"
    with pytest.raises(VislamError, match=f"cannot read this map: it is a {kind}, not a file"):
        check_regular(path, "this map")
    with pytest.raises(VislamError, match=kind), open_input(path):
        pass


def test_a_link_to_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("text")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert read_text(tmp_path / "link") == "text"


@pytest.mark.parametrize(
    ("path", "words"), [("none", "No such file"), ("a\0b", "NUL"), ("x" * 300, "too long")]
)
def test_a_path_that_leads_nowhere_is_named(tmp_path: Path, path: str, words: str) -> None:
    with pytest.raises(VislamError, match=words):
        read_text(tmp_path / path)


@pytest.mark.parametrize(("size", "fits"), [(LARGEST_TEXT, True), (LARGEST_TEXT + 1, False)])
def test_a_text_has_a_largest_size(tmp_path: Path, size: int, fits: bool) -> None:
    (tmp_path / "a").write_bytes(b" " * size)
    if fits:
        assert len(read_text(tmp_path / "a")) == size
    else:
        with pytest.raises(VislamError, match="larger than 1024 kB"):
            read_text(tmp_path / "a")


def test_lines_come_with_their_numbers_and_tell_whether_they_are_whole(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one\r\n\nthree")
    assert list(read_lines(tmp_path / "a")) == [
        (1, "one", True),
        (2, "", True),
        (3, "three", False),
    ]


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("\ufeff1 µs\n\ufeff2\n", encoding="utf-8")
    assert read_text(tmp_path / "a") == "1 µs\n\ufeff2\n"
    assert [line for _, line, _ in read_lines(tmp_path / "a")] == ["1 µs", "\ufeff2"]


@pytest.mark.parametrize(("length", "fits"), [((1 << 16) - 1, True), (1 << 16, False)])
def test_a_line_has_a_largest_length(tmp_path: Path, length: int, fits: bool) -> None:
    (tmp_path / "a").write_bytes(b"x" * length)
    if fits:
        assert len(next(read_lines(tmp_path / "a"))[1]) == length
    else:
        with pytest.raises(VislamError, match="line 1 is longer than 64 kB"):
            list(read_lines(tmp_path / "a"))


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"\xff\n")
    for read in (read_text, lambda path: list(read_lines(path))):
        with pytest.raises(VislamError, match="not a text file"):
            read(tmp_path / "a")
