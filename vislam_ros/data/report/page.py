# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The page: one HTML file with its data, its styles and plotly's JavaScript inside."""

import html
import importlib.resources
from pathlib import Path
from types import ModuleType
from typing import Any

from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.evaluation.laid_paths import laid_paths
from vislam_ros.data.files.whole_file import made_directory, refuse_existing, replace_file
from vislam_ros.data.report import words
from vislam_ros.data.report.scene import drawn_landmarks, scene_figure
from vislam_ros.data.report.series import series_figures
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

# The browser itself keeps the page from asking the network for anything. plotly compiles some of
# its own code, hence "unsafe-eval".
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:"
)


def write_report(
    results: Results,
    output: Path,
    *,
    reference: Trajectory | None = None,
    reference_path: Path | None = None,
    findings: words.Findings | None = None,
    force: bool = False,
) -> None:
    """Write a result directory as one page that opens offline.

    Parameters
    ----------
    results : Results
    output : Path
        An HTML file.
    reference : Trajectory, optional
        The truth, in the page as a path, as errors and in a table.
    reference_path : Path, optional
        Where it came from, for the command that repeats the evaluation.
    findings : sequence of mapping, optional
        What is wrong with the data, as ``vislam inspect --json`` lists it; None where nobody
        has looked.
    force : bool
        Replace a file that exists.

    Raises
    ------
    VislamError
        Where plotly is not installed, the file exists and ``force`` is not given, the reference
        is of another drive, or the page cannot be written.
    """
    refuse_existing(output, force=force)
    page = report_html(results, reference, reference_path, findings)
    with made_directory(output.parent):
        replace_file(output, page.encode("utf-8"))


def report_html(
    results: Results,
    reference: Trajectory | None = None,
    reference_path: Path | None = None,
    findings: words.Findings | None = None,
) -> str:
    """Text of the page; arguments and errors as for :func:`write_report`."""
    plotly = _plotly()
    laid = laid_paths(results, reference)
    errors = None
    if reference is not None:
        errors = compare(reference, results.trajectory, results.covariances)
    scene = _json(plotly, scene_figure(results, laid))
    series = ",".join(_json(plotly, figure) for figure in series_figures(results, reference))
    drawn = len(drawn_landmarks(results, laid)[0])
    there = 0 if results.landmarks is None else len(results.landmarks)
    note = f"{drawn:,} of {there:,} landmarks are drawn"
    note += ": those near the path, evenly along it. " if drawn < there else ". "
    if laid.laying:
        note += f"Paths: {laid.laying}; errors are RMS distances of what is drawn. "
    sections = [
        f"<h1>{html.escape(results.name)}</h1>",
        words.verdict_html(results),
        f'<div class="tiles">{words.tiles_html(results, errors)}</div>',
        "<h2>Path and map</h2>",
        '<div id="map"></div>',
        f'<p class="note">{html.escape(note)}A click on the estimate marks its moment below.</p>',
        "<h2>Over time</h2>",
        '<p class="note">A moment that is pointed at shows in the map: <span id="now">none</span>.'
        "</p>",
        '<div id="series"></div>',
        '<div class="columns">',
        f"<section><h2>Findings</h2>{words.findings_html(findings)}</section>",
    ]
    if errors is not None:
        sections.append(f"<section><h2>Errors</h2>{words.errors_html(errors)}</section>")
    sections += [
        f"<section><h2>Last estimates</h2>{words.estimates_html(results.summary)}</section>",
        f"<section><h2>Parameters</h2>{words.parameters_html(results)}</section>",
        "</div>",
        f"<h2>Reproduce</h2>{words.reproduction_html(results, reference_path)}",
    ]
    figures = f'{{"scene":{scene},"series":[{series}]}}'
    return _document(plotly, results.name, "\n".join(sections), figures)


def _json(plotly: ModuleType, figure: dict[str, Any]) -> str:
    text: str = plotly.io.to_json(plotly.graph_objects.Figure(figure))
    # Inside a script element only its end tag is markup.
    return text.replace("</", "<\\/")


def _document(plotly: ModuleType, title: str, body: str, figures: str) -> str:
    files = importlib.resources.files("vislam_ros.data.report")
    style = (files / "page.css").read_text(encoding="utf-8")
    script = (files / "page.js").read_text(encoding="utf-8")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{html.escape(title)}</title>
<style>{style}</style>
</head>
<body>
{body}
<script type="application/json" id="figures">{figures}</script>
<script>{plotly.offline.get_plotlyjs()}</script>
<script>{script}</script>
</body>
</html>
"""


def _plotly() -> ModuleType:
    # Not needed by anything else, and slow to import.
    try:
        import plotly.graph_objects
        import plotly.io
        import plotly.offline
    except ImportError as error:
        raise VislamError(
            "the report needs plotly, which is not installed: pip install 'vislam_ros[report]'"
        ) from error
    return plotly
