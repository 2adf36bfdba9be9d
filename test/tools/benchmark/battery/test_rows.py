# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from benchmark.battery.rows import (
    Imaged,
    Recorded,
    Simulated,
    all_rows,
    available,
    files_of,
    images_beside,
    quick_rows,
)


def test_there_are_many_rows_and_each_has_a_name_of_its_own() -> None:
    rows = all_rows()
    assert 120 <= len(rows) <= 170
    assert len({row.name for row in rows}) == len(set(rows)) == len(rows)
    assert set(quick_rows()) <= set(rows)


def test_a_row_needs_its_drive_and_its_reference(tmp_path: Path) -> None:
    whole, half = Recorded("0020"), Recorded("0022", quarter=1)
    simulated = [row for row in all_rows() if isinstance(row, Simulated)]
    data = tmp_path / "data"
    for file in (*files_of(data, "0020"), files_of(data, "0022")[0]):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    drawn, recorded = Imaged("street"), Imaged("kitti_0020")
    solvable, missing = available([whole, half, *simulated, drawn, recorded], tmp_path / "data")
    assert solvable == [whole, *simulated, drawn]
    assert missing == ["0022", "kitti_0020"]
    images_beside(tmp_path / "data").mkdir(parents=True)
    assert available([drawn, recorded], tmp_path / "data") == ([drawn, recorded], [])
