# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import io
from typing import Any

import matplotlib.image
import pytest
from benchmark.battery.picture import draw_battery
from benchmark.battery.rows import all_rows


def row(name: str, group: str, **others: Any) -> dict[str, Any]:
    errors = {"dead_reckoning_percent": 2.0, "estimate_percent": 3.0, "smoothed_percent": 0.02}
    return {"name": name, "group": group, "worse": True, "failed": 0, **errors, **others}


def size(png: bytes) -> tuple[int, int]:
    """Width and height, pixels."""
    height, width = matplotlib.image.imread(io.BytesIO(png)).shape[:2]
    return width, height


def test_many_rows_are_drawn_in_two_columns_and_few_in_one() -> None:
    whole = size(draw_battery([row(some.name, some.group) for some in all_rows()]))
    few = size(draw_battery([row("a", "walks"), row("b", "drives", beside_percent=5.0)]))
    assert whole[0] == 2 * few[0]
    assert 0.5 < whole[1] / whole[0] < 1.5
    assert few[1] < few[0]


@pytest.mark.parametrize("known", [0, 1])
def test_rows_without_an_estimate_leave_their_line_empty(known: int) -> None:
    failed = row(
        "a",
        "walks",
        dead_reckoning_percent=None,
        estimate_percent=None,
        smoothed_percent=None,
        worse=None,
        failed=3,
    )
    assert size(draw_battery([failed, *[row("b", "walks")] * known]))[0] > 100
