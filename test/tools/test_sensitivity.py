# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""tools/sensitivity.py tries each value on each drive, once, and writes what they say."""

import json
from pathlib import Path

import pytest
import sensitivity
from benchmark.sensitivity.constants import CONSTANTS, Constant
from places import REPOSITORY

OPTIONS = ["--only", "_PRIOR_NUMBERS", "--quick", "--simulated", "--seeds", "1", "--jobs", "1"]


def test_an_interrupted_run_goes_on_and_the_table_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [*OPTIONS, "--out", str(tmp_path)]
    assert sensitivity.main(options) == 0
    table = capsys.readouterr().out
    assert table == (tmp_path / "table.md").read_text()
    report = json.loads((tmp_path / "sensitivity.json").read_text())
    assert [result["value"] for result in report["results"]] == [None, 3.0, 12.0]
    assert len(report["drives"]) == report["results"][0]["simulated"]["drives"] == 6

    runs = tmp_path / "runs.jsonl"
    lines = runs.read_text().splitlines(keepends=True)
    assert len(lines) == 18
    runs.write_text("".join(lines[:15]))
    assert sensitivity.main(options) == 0
    assert capsys.readouterr().out == table
    assert sorted(json.loads(line)["key"] for line in runs.read_text().splitlines()) == sorted(
        json.loads(line)["key"] for line in lines
    )


def test_a_part_of_no_name_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sensitivity.main(["--only", "nonsense", "--out", str(tmp_path)]) == 1
    assert "nonsense" in capsys.readouterr().err


@pytest.mark.parametrize("constant", CONSTANTS, ids=lambda constant: constant.key)
def test_every_constant_is_explained(constant: Constant) -> None:
    page = (REPOSITORY / "docs" / "constants.md").read_text()
    assert f"`{constant.key}`" in page
