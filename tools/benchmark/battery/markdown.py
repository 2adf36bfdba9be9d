# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The battery's tables as a Markdown page."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.report_table import (
    BATTERY_GROUPS,
    BATTERY_ROWS,
    Columns,
    cells,
    known_columns,
)

_INTRODUCTION = """\
# The battery

Errors are those of the position over stretches of 50 to 400 m, per cent of their length; of a path
under 100 m over eighths of it. Rows are means over their seeds, groups geometric means over their
rows. A row is worse where the estimate's error in metres is more than 1.05 times that of dead
reckoning and 0.02 m.
"""


def markdown(
    summed: Sequence[Mapping[str, Any]],
    groups: Sequence[Mapping[str, Any]],
    notes: Sequence[str] = (),
) -> str:
    """Page with the table of groups, one of the rows of each, and what did not go well.

    Parameters
    ----------
    summed, groups : sequence of mapping
        Of :mod:`benchmark.battery.summary`.
    notes : sequence of str
        Rows that are left out, trials that failed.
    """
    parts = [_INTRODUCTION, _table(BATTERY_GROUPS, groups)]
    for group in dict.fromkeys(row["group"] for row in summed):
        rows = [row for row in summed if row["group"] == group]
        parts.append(f"## {group.capitalize()}\n\n{_table(BATTERY_ROWS, rows)}")
    if notes:
        parts.append("## Notes\n\n" + "".join(f"- {note}\n" for note in notes))
    return "\n".join(parts)


def _table(columns: Columns, rows: Sequence[Mapping[str, Any]]) -> str:
    known = known_columns(columns, rows)
    rule = ["---" if key == "name" else "---:" for key, _, _ in known]
    lines = [[heading for _, heading, _ in known], rule, *(cells(known, row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
