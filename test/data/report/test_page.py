# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import base64
import dataclasses
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.evaluation.laid_paths import laid_paths
from vislam_ros.data.report.page import report_html, write_report
from vislam_ros.data.report.scene import MOST_LANDMARKS, drawn_landmarks, evenly, scene_figure
from vislam_ros.data.report.series import series_figures
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError


@pytest.fixture
def plotly() -> Any:
    return pytest.importorskip("plotly", reason="the extra report is not installed")


def figures_of(page: str) -> dict[str, Any]:
    """Data of the charts as the page holds them."""
    (text,) = re.findall(r'<script type="application/json" id="figures">(.*?)</script>', page)
    figures: dict[str, Any] = json.loads(text)
    return figures


def numbers(array: Any) -> np.ndarray:
    """Numbers of a trace, as a list or as plotly packs them."""
    if isinstance(array, dict):
        return np.frombuffer(base64.b64decode(array["bdata"]), array["dtype"])
    return np.array(array)


def with_map(results: Results, positions: np.ndarray) -> Results:
    ids = np.arange(len(positions), dtype=np.uint32)
    covariances = np.tile(0.04 * np.eye(3), (len(positions), 1, 1))
    landmarks = LandmarkMap(ids, 0 * ids, positions, covariances)
    return dataclasses.replace(results, landmarks=landmarks)


@pytest.mark.usefixtures("plotly")
def test_the_page_holds_path_map_series_and_how_to_do_it_again(
    round_results: Results, round_drive: Trajectory, moved_round: Trajectory
) -> None:
    page = report_html(round_results, moved_round, Path("truth.tum"))
    figures = figures_of(page)
    traces = {trace["name"].split(",")[0]: trace for trace in figures["scene"]["data"]}
    assert list(traces) == [
        "estimate",
        "dead reckoning",
        "reference",
        "landmarks",
        "start",
        "end",
        "now",
    ]
    for axis, column in zip("xyz", round_drive.positions.T, strict=True):
        np.testing.assert_allclose(numbers(traces["estimate"][axis]), column, atol=1e-5)
        np.testing.assert_allclose(numbers(traces["reference"][axis]), column, atol=1e-5)
    np.testing.assert_allclose(numbers(traces["estimate"]["customdata"]), 0.1 * np.arange(60))
    titles = [chart["layout"]["annotations"][0]["text"] for chart in figures["series"]]
    for word in ("landmarks", "NIS", "step", "position", "error yaw", "NEES", "gyro bias"):
        assert any(word in title for title in titles), word
    for text in ("robocentric", "chi2_gate: 16.27", "0.000 m", "--reference truth.tum"):
        assert text in page


@pytest.mark.usefixtures("plotly")
def test_nothing_in_the_page_asks_the_network(round_results: Results) -> None:
    page = report_html(round_results)
    markup = re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert not re.findall(r"(?:src|href)=|url\(|@import", markup)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1].startswith("default-src 'none';")
    assert "http" not in policy[1]


@pytest.mark.usefixtures("plotly")
def test_names_and_reasons_are_no_markup(round_results: Results) -> None:
    nasty = "</script><img src=x>"
    round_results.summary.update(drive=nasty, verdict="doubtful", verdict_reasons=[nasty])
    findings = [{"name": nasty, "words": nasty, "advice": nasty}]
    page = report_html(round_results, findings=findings)
    assert "<img" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert page.count(html_of(nasty)) >= 5


def html_of(text: str) -> str:
    return text.replace("<", "&lt;").replace(">", "&gt;")


@pytest.mark.usefixtures("plotly")
def test_findings_are_listed_or_said_to_be_unknown(round_results: Results) -> None:
    assert "vislam inspect" in report_html(round_results)
    assert "Nothing wrong" in report_html(round_results, findings=[])
    finding = {"name": "gyro_bias", "words": "0.01 rad/s", "advice": "none", "is_repaired": True}
    page = report_html(round_results, findings=[finding])
    assert "<b>gyro_bias</b>: 0.01 rad/s" in page
    assert '<span class="done">done</span>' in page


@pytest.mark.usefixtures("plotly")
def test_a_run_that_is_not_whole_says_so(round_results: Results) -> None:
    assert "<li>incomplete" not in report_html(round_results)
    round_results.summary.update(complete=False, incomplete_reason="the run was interrupted")
    assert "<li>incomplete: the run was interrupted" in report_html(round_results)


@pytest.mark.usefixtures("plotly")
def test_a_large_map_makes_no_large_page(round_results: Results) -> None:
    rng = np.random.default_rng(0)
    small = len(report_html(round_results))
    page = report_html(with_map(round_results, rng.uniform(-20.0, 40.0, (400_000, 3))))
    assert f"{MOST_LANDMARKS:,} of 400,000 landmarks" in page
    assert len(page) - small < 40 * MOST_LANDMARKS
    assert len(page) < 15_000_000


def test_drawn_landmarks_are_those_near_the_path_and_spread_over_the_drive(
    round_results: Results,
) -> None:
    positions = np.zeros((2 * MOST_LANDMARKS + 5, 3))
    positions[7] = [1e6, 0.0, 0.0]
    positions[9] = [0.0, 0.0, -500.0]
    results = with_map(round_results, positions)
    rows, std = drawn_landmarks(results, laid_paths(results))
    assert len(rows) == MOST_LANDMARKS
    assert not {7, 9} & set(rows.tolist())
    assert (rows[0], rows[-1]) == (0, len(positions) - 1)
    assert np.diff(rows).max() <= 4
    np.testing.assert_allclose(std, 0.2)
    empty = dataclasses.replace(results, landmarks=LandmarkMap.empty())
    names = [trace["name"] for trace in scene_figure(empty, laid_paths(empty))["data"]]
    assert "landmarks" not in names


def test_rows_are_all_or_even_with_both_ends() -> None:
    assert evenly(5, 5).tolist() == [0, 1, 2, 3, 4]
    assert evenly(7, 3).tolist() == [0, 3, 6]


def test_the_band_of_the_nis_holds_most_of_it(round_results: Results) -> None:
    charts = series_figures(round_results)
    assert len(charts) == 5
    # At the 2.5 and 97.5 % points of chi-square with 90 degrees.
    (band,) = (trace for trace in charts[1]["data"] if trace.get("fill"))
    assert (band["y"].min(), band["y"].max()) == pytest.approx((65.6466 / 90, 118.1359 / 90), 1e-4)


def test_the_last_chart_names_the_axis_of_all(round_results: Results) -> None:
    names = [chart["layout"]["xaxis"]["title"]["text"] for chart in series_figures(round_results)]
    assert names == ["", "", "", "", "time [s]"]


def test_steps_that_were_not_recorded_leave_their_charts_out(round_results: Results) -> None:
    steps = {name: column[:0] for name, column in round_results.steps.items()}
    (chart,) = series_figures(dataclasses.replace(round_results, steps=steps))
    assert "<b>\N{GREEK SMALL LETTER SIGMA}" in chart["layout"]["annotations"][0]["text"]


@pytest.mark.usefixtures("plotly")
def test_a_page_that_exists_is_not_replaced_unasked(
    round_results: Results, tmp_path: Path
) -> None:
    output = tmp_path / "pages" / "report.html"
    write_report(round_results, output)
    before = output.read_bytes()
    with pytest.raises(VislamError, match=r"report.html: exists already"):
        write_report(round_results, output)
    write_report(round_results, output, force=True)
    assert output.read_bytes() == before


def test_without_plotly_it_is_told_in_a_line(
    round_results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("plotly", "plotly.graph_objects", "plotly.io", "plotly.offline"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(VislamError, match=r"pip install 'vislam_ros\[report\]'"):
        report_html(round_results)
