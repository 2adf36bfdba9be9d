# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The last error of a child is found among what it says."""

import io

import pytest

from vislam_ros.cli.child_log import ChildLog

TRACEBACK = """\
Traceback (most recent call last):
  File "node.py", line 1, in <module>
    spin()
MemoryError: Unable to allocate 3 GiB
"""


@pytest.mark.parametrize(
    ("said", "error"),
    [
        ("", None),
        ("[INFO] [1.5] [slam_node]: all is well\n", None),
        ("[ERROR] [1.5] [slam_node]: no map\n[INFO] [1.6] [slam_node]: good-bye\n", "no map"),
        ("[ERROR] [1.5] [a]: first\n[FATAL] [1.6] [a]: second\n", "second"),
        ("error: /out/steps.csv: cannot write\nbye\n", "/out/steps.csv: cannot write"),
        (f"{TRACEBACK}[INFO] [2.0] [a]: after\n", "MemoryError: Unable to allocate 3 GiB"),
        ("Fatal Python error: Segmentation fault\n\nThread 0x1:\n", None),
        ("terminate called after throwing an instance of 'x'\n  what():  no memory\n", None),
        ("error: \xff\xfe", "\ufffd\ufffd"),
    ],
)
def test_the_last_error_is_found_among_other_lines(tmp_path, said, error):
    expected = {
        "Fatal": "Fatal Python error: Segmentation fault",
        "termi": "what():  no memory",
    }.get(said[:5], error)
    path = tmp_path / "child.log"
    log = ChildLog(path, io.BytesIO(said.encode("latin-1")))
    assert log.last_error() == expected
    assert path.read_bytes() == said.encode("latin-1")


def test_a_full_disk_keeps_nothing_of_the_log_but_the_error():
    from pathlib import Path

    log = ChildLog(Path("/dev/full"), io.BytesIO(b"error: no space\n"))
    assert log.last_error() == "no space"
