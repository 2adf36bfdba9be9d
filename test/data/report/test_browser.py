# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page in Chromium, where there is one: what it shows, and that it asks for nothing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from vislam_ros.data.report.page import write_report
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

SIZES = {"wide": (1280, 900), "narrow": (390, 844)}
PATIENCE = 120_000  # milliseconds, on a machine that draws in software and is busy


@pytest.fixture(params=SIZES)
def opened(
    request: pytest.FixtureRequest,
    browser: Any,
    round_results: Results,
    moved_round: Trajectory,
    tmp_path: Path,
) -> Iterator[Any]:
    """The page when its charts are drawn, with all that it asked for and complained of."""
    pytest.importorskip("plotly", reason="the extra report is not installed")
    write_report(round_results, tmp_path / "report.html", reference=moved_round)
    width, height = SIZES[request.param]
    context = browser.new_context(viewport={"width": width, "height": height})
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    page.asked, page.complaints = [], []
    page.on("request", lambda asked: page.asked.append(asked.url))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("console", lambda said: said.type == "error" and page.complaints.append(said.text))
    page.goto((tmp_path / "report.html").as_uri())
    page.wait_for_selector("html[data-drawn-ms]", state="attached")
    yield page
    context.close()


def test_it_is_drawn_without_the_network(opened: Any) -> None:
    assert not opened.complaints
    assert not [url for url in opened.asked if not url.startswith(("file:", "data:", "blob:"))]
    assert opened.locator("#map canvas").count() > 0
    assert opened.locator("#series .nsewdrag").count() > 10
    picture = opened.locator("#map").screenshot()
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).astype(int)
    red = (pixels[:, :, 2] > 150) & (pixels[:, :, 1] < 90) & (pixels[:, :, 0] < 90)
    assert red.sum() > 50  # the path


def test_nothing_is_wider_than_the_screen(opened: Any) -> None:
    width = opened.evaluate("document.documentElement.clientWidth")
    assert opened.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("#map", "#series", ".tiles"):
        box = opened.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width + 0.5


def box_of_chart(opened: Any, number: int) -> Any:
    """Where a chart's plot is on the screen, to which it is brought."""
    chart = opened.locator("#series .nsewdrag").nth(number)
    chart.scroll_into_view_if_needed()
    return chart.bounding_box()


def test_a_moment_in_the_series_shows_in_the_map(opened: Any, round_results: Results) -> None:
    box = box_of_chart(opened, 0)
    opened.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.wait_for_function("document.getElementById('now').textContent !== 'none'")
    time, place = opened.locator("#now").inner_text().split(" s: ")
    assert 1.0 < float(time) < 5.0
    position = round_results.trajectory.positions[round(float(time) * 10)]
    shown = [float(value) for value in place.removesuffix(" m").split(",")]
    np.testing.assert_allclose(shown, position, atol=0.006)
    opened.wait_for_function(
        "(() => { const all = document.getElementById('map')._fullData;"
        " return all[all.length - 1].visible === true; })()"
    )


def test_all_charts_show_the_stretch_of_time_that_one_is_drawn_over(opened: Any) -> None:
    box = box_of_chart(opened, 2)
    middle = box["y"] + box["height"] / 2
    ends = [box["x"] + share * box["width"] for share in (0.25, 0.75)]
    whole, heard = ranges_of_time(opened)[0], hearers(opened)
    opened.mouse.move(ends[0], middle)
    opened.mouse.down()
    opened.mouse.move(ends[1], middle, steps=4)
    opened.mouse.up()
    opened.wait_for_function(
        "Array.from(document.querySelectorAll('#series > div')).every("
        " (chart) => chart._fullLayout.xaxis.range[0] > 1)"
    )
    (shown,) = {tuple(each) for each in ranges_of_time(opened)}
    low, high = (whole[0] + share * (whole[1] - whole[0]) for share in (0.25, 0.75))
    assert shown == pytest.approx((low, high), abs=0.1)
    assert hearers(opened) == heard  # a chart that is drawn anew tells each moment once, as before


def ranges_of_time(opened: Any) -> Any:
    return opened.evaluate(
        "Array.from(document.querySelectorAll('#series > div'),"
        " (chart) => chart._fullLayout.xaxis.range)"
    )


def hearers(opened: Any) -> Any:
    """How many hear of a moment that is pointed at, for each chart."""
    return opened.evaluate(
        "Array.from(document.querySelectorAll('#series > div'),"
        " (chart) => chart._ev.listenerCount('plotly_hover'))"
    )


def test_a_moment_in_one_chart_shows_in_those_beside_it(opened: Any) -> None:
    box = box_of_chart(opened, 2)
    opened.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.wait_for_function(
        "Array.from(document.querySelectorAll('#series > div')).filter("
        " (chart) => chart.querySelector('.hoverlayer .hovertext')).length > 2"
    )


def test_parameters_open_at_a_touch(opened: Any) -> None:
    parameters = opened.locator("details", has_text="slam_node")
    assert not parameters.locator("pre").is_visible()
    parameters.locator("summary").click()
    assert "chi2_gate" in parameters.locator("pre").inner_text()
