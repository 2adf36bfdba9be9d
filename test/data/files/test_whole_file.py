# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from vislam_ros.data.files.whole_file import refuse_existing, replace_file, replace_files
from vislam_ros.errors import VislamError


def test_a_file_is_replaced_whole_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    replace_file(tmp_path / "a.json", b"old")
    replace_file(tmp_path / "a.json", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_bytes() == b"new"


def test_a_place_that_cannot_be_written_is_a_known_error(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="cannot write this file: No such file"):
        replace_file(tmp_path / "missing" / "a.json", b"new")


def test_an_existing_file_is_refused_without_force(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    refuse_existing(path, force=False)
    path.touch()
    refuse_existing(path, force=True)
    with pytest.raises(VislamError, match=r"exists already.*--force"):
        refuse_existing(path, force=False)


def test_of_several_files_none_is_written_where_one_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(VislamError, match="b: cannot write this file"):
        replace_files({tmp_path / "a": b"1", tmp_path / "file" / "b": b"2"})
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_nothing_is_left_beside_a_file_that_could_not_be_put_in_place(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(VislamError, match="a: cannot write this file"):
        replace_file(tmp_path / "a", b"1")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
