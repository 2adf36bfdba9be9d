# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a report says in words and tables, as HTML; nothing that a file holds is markup."""

import hashlib
import html
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from vislam_ros import __version__
from vislam_ros.core.filters.quantities import OF_EVERY_STEP, OF_ROBOCENTRIC
from vislam_ros.data.evaluation.evaluate import length_words
from vislam_ros.data.results.estimate_rows import estimate_rows
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import path_length

#: An entry of what ``vislam inspect --json`` lists as ``findings``.
Findings = Sequence[Mapping[str, Any]]

_VERDICTS = {
    "good": "The estimate can be trusted.",
    "doubtful": "Do not rely on the estimate before the reasons are understood.",
    "contradiction": "Images and motion contradict each other: the estimate is wrong.",
}


def verdict_html(results: Results) -> str:
    """Say whether the estimate can be trusted, and why not; and whether it is whole."""
    summary = results.summary
    word = summary.get("verdict") or "unknown"
    meaning = _VERDICTS.get(word, "No verdict was given.")
    reasons = [*summary.get("verdict_reasons", [])]
    if not summary.get("complete", False):
        reasons.insert(0, f"incomplete: {summary.get('incomplete_reason')}")
    items = "".join(f"<li>{_text(reason)}</li>" for reason in reasons)
    kind = word if word in _VERDICTS else "unknown"
    return f'<p class="verdict {kind}"><b>{_text(word)}</b> {_text(meaning)}</p>' + (
        f"<ul>{items}</ul>" if items else ""
    )


def tiles_html(results: Results, errors: Mapping[str, Any] | None) -> str:
    """Show the figures that are asked for first."""
    summary = results.summary
    tiles = [
        ("filter", summary.get("estimator")),
        ("path", length_words(path_length(results.trajectory))),
        ("duration", _number(summary.get("drive_s"), "{:.1f} s")),
        ("steps", _number(summary.get("steps"), "{:,}")),
        ("landmarks", _number(summary.get("landmarks"), "{:,}")),
        ("ATE", None if errors is None else length_words(errors["ate_m"]["rmse"])),
        ("NEES / 6", None if errors is None else _number(errors.get("nees_per_dof"), "{:.2f}")),
        ("NIS / dof", _number(summary.get("nis_per_dof"), "{:.2f}")),
        ("rejected", _number(summary.get("rejected_fraction"), "{:.2%}")),
        ("step, median", _number(summary.get("step_ms_p50"), "{:.1f} ms")),
        ("latency, 99 %", _number(summary.get("latency_ms_p99"), "{:.1f} ms")),
        ("times real time", _number(summary.get("realtime_factor"), "{:.1f}")),
    ]
    return "".join(
        f'<div class="tile"><b>{_text(value)}</b><span>{_text(name)}</span></div>'
        for name, value in tiles
        if value is not None
    )


def errors_html(errors: Mapping[str, Any]) -> str:
    """Tabulate a comparison with the reference, as ``vislam evaluate`` has it."""
    rows = [("ATE, RMS [m]", f"{errors['ate_m']['rmse']:.3f}")]
    for name, label in (("frame", "from frame to frame"), ("100m", "over 100 m")):
        rows += [
            (f"RPE {label}, RMS [{unit}]", f"{figures['rmse']:.3f}")
            for unit in ("m", "deg")
            if (figures := errors.get(f"rpe_{name}_{unit}"))
        ]
    if kitti := errors.get("kitti"):
        rows.append(("KITTI, translation [%]", f"{kitti['translation_percent']:.2f}"))
        rows.append(("KITTI, rotation [°/100 m]", f"{kitti['rotation_deg_per_100m']:.2f}"))
    if errors.get("nees_per_dof") is not None:
        low, high = errors["nees_bounds"]
        rows.append(("NEES / 6", f"{errors['nees_per_dof']:.2f}"))
        rows.append((f"poses within {low:.2f} to {high:.2f}", f"{errors['nees_inside']:.0%}"))
    note = errors.get("alignment_ambiguity")
    return table_html(rows) + (f"<p>{_text(note)}</p>" if note else "")


def findings_html(findings: Findings | None) -> str:
    """List what is wrong with the data; ``None`` says that nobody has looked."""
    if findings is None:
        return (
            "<p>Not looked for. <code>vislam inspect DATA --json &gt; DIR/findings.json</code> "
            "tells what is wrong with the data, and the next report shows it.</p>"
        )
    if not findings:
        return "<p>Nothing wrong was found with the data.</p>"
    items = []
    for each in findings:
        state = "done" if each.get("is_repaired") else "to do"
        items.append(
            f"<li><b>{_text(each.get('name', ''))}</b>: {_text(each.get('words', ''))}"
            f'<br><span class="{state.replace(" ", "")}">{state}</span> '
            f"{_text(each.get('advice', ''))}</li>"
        )
    return f'<ul class="findings">{"".join(items)}</ul>'


def estimates_html(summary: Mapping[str, Any]) -> str:
    """Tabulate the last values of what the filter estimates besides pose and map."""
    rows = estimate_rows(summary.get("estimates", {}), (*OF_EVERY_STEP, *OF_ROBOCENTRIC))
    return table_html(rows.items())


def parameters_html(results: Results) -> str:
    """Show the parameters as used, a node each."""
    blocks = []
    for node, values in results.parameters.items():
        text = yaml.safe_dump(dict(values), default_flow_style=None, sort_keys=True, width=60)
        blocks.append(
            f"<details><summary>{_text(node)} ({len(values)})</summary>"
            f"<pre>{_text(text)}</pre></details>"
        )
    return "".join(blocks) or "<p>None were written.</p>"


def reproduction_html(results: Results, reference: Path | None) -> str:
    """Say how the same trajectory comes about again, and how to see that it is the same."""
    trajectory = results.directory / "trajectory.tum"
    digest = hashlib.sha256(trajectory.read_bytes()).hexdigest()
    parameters = str(results.directory / "params.yaml")
    lines = [
        f"# vislam_ros {__version__}",
        shlex.join(["vislam", "solve", "DATA", "--out", "again", "--params", parameters]),
        "sha256sum again/trajectory.tum",
    ]
    if reference is not None:
        lines.append(shlex.join(["vislam", "evaluate", "again", "--reference", str(reference)]))
    return (
        f"<p><code>DATA</code> is the drive <b>{_text(results.name)}</b>. Live or offline, the "
        "same data and parameters give the same file on the same machine and versions:</p>"
        f"<pre>{_text(chr(10).join(lines))}</pre>"
        f'<p>SHA-256 of <code>trajectory.tum</code>: <code class="long">{digest}</code></p>'
    )


def table_html(rows: Iterable[tuple[str, str]]) -> str:
    """Tabulate names and values."""
    cells = "".join(f"<tr><td>{_text(a)}</td><td>{_text(b)}</td></tr>" for a, b in rows)
    return f'<div class="wide"><table>{cells}</table></div>'


def _text(value: object) -> str:
    return html.escape(str(value))


def _number(value: Any, style: str) -> str | None:
    return None if value is None else style.format(value)
