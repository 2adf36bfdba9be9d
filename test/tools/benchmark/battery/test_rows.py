# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from benchmark.battery.rows import Recorded, all_rows, available, files_of, quick_rows


def test_there_are_many_rows_and_each_has_a_name_of_its_own() -> None:
    rows = all_rows()
    assert 120 <= len(rows) <= 170
    assert len({row.name for row in rows}) == len(set(rows)) == len(rows)
    assert set(quick_rows()) <= set(rows)


def test_a_row_needs_its_drive_and_its_reference(tmp_path: Path) -> None:
    whole, half = Recorded("0020"), Recorded("0022", quarter=1)
    simulated = [row for row in all_rows() if not isinstance(row, Recorded)]
    for file in (*files_of(tmp_path, "0020"), files_of(tmp_path, "0022")[0]):
        file.parent.mkdir(exist_ok=True)
        file.touch()
    solvable, missing = available([whole, half, *simulated], tmp_path)
    assert solvable == [whole, *simulated]
    assert missing == ["0022"]
