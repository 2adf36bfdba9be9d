# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines are whole or not there, and nothing is written into a file that is gone."""

import resource

import pytest

from vislam_ros.data.files.open_file import append, require_present


@pytest.fixture
def path(tmp_path):
    return tmp_path / "rows.csv"


def test_what_does_not_fit_leaves_nothing_of_itself(path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with path.open("wb", buffering=0) as file:
        append(file, b"whole\n")
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
            with pytest.raises(OSError, match="File too large"):
                append(file, b"too long to fit\n")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        append(file, b"goes on\n")
    assert path.read_bytes() == b"whole\ngoes on\n"


def test_a_file_at_its_place_is_present(path):
    with path.open("wb", buffering=0) as file:
        require_present(path, file)


def test_a_file_that_was_deleted_or_replaced_is_not(path):
    with path.open("wb", buffering=0) as file:
        path.unlink()
        with pytest.raises(FileNotFoundError, match="No such file"):
            require_present(path, file)
        path.write_bytes(b"another")
        with pytest.raises(FileNotFoundError, match="it was replaced while"):
            require_present(path, file)
