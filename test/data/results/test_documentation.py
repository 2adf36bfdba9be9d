# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``docs/results.md`` says of each file, column and key what is so."""

import re

from places import REPOSITORY

from vislam_ros.core.columns import Column, Quantity
from vislam_ros.core.filters.quantities import OF_EVERY_STEP, OF_ROBOCENTRIC
from vislam_ros.core.step import COLUMNS
from vislam_ros.data.results.file_names import OWNED_FILES
from vislam_ros.data.results.summary import RunSummary

PAGE = (REPOSITORY / "docs" / "results.md").read_text(encoding="utf-8")


def table_below(header: str, start: str = "") -> list[str]:
    """Lines of the first table with a header behind some words of the page."""
    page = PAGE[PAGE.index(start) :]
    table = page[page.index(f"| {header} |") :].split("\n\n")[0]
    return table.splitlines()[2:]


def first_cells(lines: list[str]) -> list[str]:
    return [re.match(r"\| `(\w[\w.]*)`", line)[1] for line in lines]


def line(columns: tuple[Column, ...]) -> str:
    """Line of columns that share their unit and their meaning."""
    names = ", ".join(f"`{column.name}`" for column in columns)
    kind, unit, meaning = columns[0].kind.__name__, columns[0].unit, columns[0].meaning
    return f"| {names} | {kind} | {unit} | {meaning} |"


def lines_of(quantities: tuple[Quantity, ...]) -> list[str]:
    parts = [
        part
        for quantity in quantities
        for n in [len(quantity.names)]
        for part in (quantity.columns[:n], quantity.columns[n:])
    ]
    return [line(part) for part in parts if part]


def test_every_column_stands_there_with_its_type_unit_and_meaning() -> None:
    columns = "column | type | unit | meaning"
    assert table_below(columns, "## Steps") == [line((column,)) for column in COLUMNS]
    assert table_below(columns, "The twist is") == lines_of(OF_EVERY_STEP)
    assert table_below(columns, "`robocentric` adds") == lines_of(OF_ROBOCENTRIC)


def test_every_key_of_the_summary_stands_there_in_its_order() -> None:
    assert first_cells(table_below("key | meaning")) == list(RunSummary().as_dict())


def test_every_file_of_a_result_directory_stands_there() -> None:
    assert sorted(first_cells(table_below("file | holds"))) == sorted(OWNED_FILES)
