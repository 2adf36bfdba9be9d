# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from typing import Any

from benchmark.battery.markdown import markdown


def row(name: str, group: str, **others: Any) -> dict[str, Any]:
    errors = {"dead_reckoning_percent": 2.0, "estimate_percent": 3.0, "to_dead_reckoning": 1.5}
    return {"name": name, "group": group, "worse": True, **errors, **others}


ROWS = [
    row("a", "walks"),
    row("b", "walks", estimate_percent=None, to_dead_reckoning=None, worse=None),
    row("c", "drives", worse=False),
]
GROUPS = [{"name": "all", "rows": 3, "worse": 1, "failed": 2, "to_dead_reckoning": 1.25}]


def test_the_page_has_a_table_of_groups_and_one_of_the_rows_of_each() -> None:
    lines = markdown(ROWS, GROUPS).splitlines()
    assert [line for line in lines if line.startswith("#")] == [
        "# The battery",
        "## Walks",
        "## Drives",
    ]
    assert "| all | 3 | 1 | 2 | 1.250 |" in lines
    assert "| a | 2.00 | 3.00 | 1.50 | yes |" in lines
    assert "| b | 2.00 |  |  |  |" in lines
    assert "| c | 2.00 | 3.00 | 1.50 |  |" in lines


def test_what_is_beside_has_columns_only_where_it_is_there() -> None:
    assert "the other" not in markdown(ROWS, GROUPS)
    beside = [row("a", "walks", beside_percent=6.0, to_beside=0.5), *ROWS[1:]]
    page = markdown(beside, GROUPS)
    assert "| a | 2.00 | 3.00 | 1.50 | 6.00 | 0.50 | yes |" in page
    # Every line of a table has as many cells as its head.
    tables = [block for block in page.split("\n\n") if block.startswith("|")]
    assert len(tables) == 3
    for table in tables:
        assert len({line.count("|") for line in table.strip().splitlines()}) == 1


def test_notes_stand_at_the_end() -> None:
    page = markdown(ROWS, GROUPS, ["0020 is not there", "c, seed 1: no"])
    assert page.endswith("## Notes\n\n- 0020 is not there\n- c, seed 1: no\n")
