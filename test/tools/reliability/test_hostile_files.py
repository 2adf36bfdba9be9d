# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile files of every kind end a command in one line, and leave nothing behind."""

import os
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import SHARED_CASES
from reliability.hostile_files import OUT, Case, cases, shared_cases
from reliability.hostile_runs import Outcome, run, table

from vislam_ros.cli.main import main

# Room beside what a test has already; what is claimed is more than the machine has [bytes].
_ROOM = 3 << 30


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def hostile(folder: Path) -> list[Case]:
    return cases(folder)


@pytest.fixture
def little_room() -> Iterator[None]:
    """Whoever believes a claim gets no memory for it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    there = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (there + _ROOM, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def faults(
    tried: list[Case], scratch: Path, capsys: pytest.CaptureFixture[str]
) -> list[tuple[str, int, str, list[str]]]:
    """What is not as it should be: case, exit code, what was said, and what was left."""
    wrong = []
    for number, case in enumerate(tried):
        place = scratch / str(number)
        place.mkdir()
        capsys.readouterr()
        code = main([word.replace(OUT, str(place / "out")) for word in case.arguments])
        said = capsys.readouterr().err
        lines = [
            line for line in said.splitlines() if not line.startswith(("note: ", "warning: "))
        ]
        left = [path.name for path in place.rglob("*")]
        is_line = len(lines) == 1 and lines[0].startswith("error: ") and lines[0].isprintable()
        if code != 1 or not is_line or "internal" in said or "memory" in said or left:
            wrong.append((f"{case.kind}: {case.name}", code, said[-300:], left))
    return wrong


@pytest.mark.usefixtures("little_room")
def test_every_hostile_file_is_one_line_and_leaves_nothing(
    hostile: list[Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tried = [case for case in hostile if not case.limits and case.stdout == os.devnull]
    assert len({case.kind for case in tried}) == 10
    assert not faults(tried, tmp_path, capsys)


@pytest.mark.usefixtures("little_room")
def test_what_others_found_is_one_line_and_leaves_nothing(
    folder: Path, hostile: list[Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shared = SHARED_CASES / "hostile"
    if not shared.is_dir():
        pytest.skip(f"needs {shared}")
    assert hostile
    tried = shared_cases(shared, folder / "seed.npz")
    assert len(tried) == 11
    assert not faults(tried, tmp_path, capsys)


@pytest.mark.parametrize("name", ["full disk behind the output", "files of at most 2 kB"])
def test_what_is_scarce_is_one_line_and_leaves_nothing(hostile: list[Case], name: str) -> None:
    (case,) = (case for case in hostile if case.name == name)
    outcome = run(case)
    assert outcome.code == 1
    assert outcome.is_one_line, outcome.lines
    assert not outcome.left


def test_the_table_has_a_row_for_each_kind_and_one_for_all() -> None:
    good = Outcome(Case("bags", "a", ()), 1, ("error: x",), (), 0.5, 0.4, 50.0)
    bad = Outcome(Case("names", "b", ()), 0, ("error: x", "y"), ("out",), 9.0, 8.0, 900.0)
    assert good.is_right
    assert not bad.is_right
    assert table([good, bad])[2:] == [
        "| bags | 1 | 1 | 1 | 1 | 0.40 | 50 |",
        "| names | 1 | 0 | 0 | 0 | 8.00 | 900 |",
        "| all | 2 | 1 | 1 | 1 | 8.00 | 900 |",
    ]
