# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam inspect``: what data are, and what is wrong with them."""

import argparse
import json
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.lines import answer, tell
from vislam_ros.cli.parameters import run_parameters
from vislam_ros.cli.played_bag import renamed_topics
from vislam_ros.cli.reading import conventions, use_format
from vislam_ros.cli.screen import print_table, progress_bar
from vislam_ros.data.inspection.inspecting import Inspection, inspect
from vislam_ros.data.inspection.streams import Stream
from vislam_ros.errors import one_line

_WIDTH = 80


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    use_format(arguments)
    with progress_bar("looking", 1.0) as _:
        told = inspect(
            arguments.data,
            arguments.motion,
            conventions=conventions(arguments),
            rules=run_parameters(arguments).reading,
            topics=renamed_topics(arguments),
            namespace=arguments.namespace,
        )
    if arguments.json:
        print(json.dumps(told.as_dict(), indent=2, allow_nan=False))
    else:
        _print(told)
    if told.error:
        tell(f"error: {told.error}")
        return FAILED
    return OK


def _print(told: Inspection) -> None:
    rows = {label: value for label, value in _rows(told.facts) if value}
    rows |= {f"{each.name}": _stream(each) for each in told.streams}
    print_table(f"{told.path}: {told.kind}", rows)
    console = Console(width=min(Console().width, _WIDTH))
    if told.findings:
        table = Table(title="findings", title_justify="left", show_header=False, show_lines=True)
        table.add_column(no_wrap=True)
        table.add_column()
        for each in told.findings:
            done = "done" if each.is_repaired else "to do"
            words = f"{one_line(each.words)}\n{done}: {one_line(each.advice)}"
            table.add_row(Text(each.name), Text(words))
        console.print(table)
    else:
        answer("nothing wrong was found")
    for name, reason in told.unknown.items():
        answer(f"not judged: {name}: {reason}")
    for note in told.notes:
        answer(f"note: {note}")


def _stream(stream: Stream) -> str:
    return f"{stream.count} at {stream.rate:.4g} Hz, jitter {1e3 * stream.jitter:.2g} ms"


def _rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Labels and values of the figures, empty where there is none."""

    def number(key: str, style: str) -> str:
        value = facts.get(key)
        return "" if value is None else style.format(value)

    def three(key: str, style: str = "{:.3g}") -> str:
        values = facts.get(key)
        return "" if not values else " / ".join(style.format(value) for value in values)

    size = facts.get("image_size") or []
    sizes = size if size and isinstance(size[0], list) else [size]
    return [
        ("frames", number("steps", "{}") or number("frames", "{}")),
        ("duration [s]", number("duration_s", "{:.1f}")),
        ("path [m]", number("path_m", "{:.1f}")),
        ("largest speed [m/s]", number("speed_max_m_s", "{:.1f}")),
        ("largest turn rate [rad/s]", number("turn_rate_max_rad_s", "{:.2f}")),
        ("frames tracked", number("tracked_frames", "{}")),
        ("tracks", number("tracks", "{}")),
        ("mean length of a track", number("track_length_mean", "{:.1f}")),
        ("observations a frame: least / median / most", three("observations_a_frame", "{}")),
        ("disparity, 5 / 50 / 95 % [px]", three("disparity_px")),
        ("depth, 5 / 50 / 95 % [m]", three("depth_m")),
        ("image size [px]", ", ".join(" x ".join(map(str, each)) for each in sizes if each)),
        ("encodings", ", ".join(facts.get("encodings", []))),
        ("rectified", number("rectified", "{}").replace("True", "yes").replace("False", "no")),
        ("lens", number("lens", "{}")),
        ("dark, saturated", _shares(facts)),
        ("brightness, its changes, contrast", _light(facts)),
        ("focal length [px]", three("focal_length_px", "{:.1f}")),
        ("baseline [m]", number("baseline_m", "{:.3f}")),
        ("velocity measured", ("no", "yes")[bool(facts.get("measures_velocity"))]),
        ("true poses", number("ground_truth_poses", "{}")),
        ("refused messages", ", ".join(f"{n} {w}" for w, n in facts.get("refused", {}).items())),
    ]


def _shares(facts: dict[str, Any]) -> str:
    if "dark_share" not in facts:
        return ""
    return f"{facts['dark_share']:.1%}, {facts['saturated_share']:.1%}"


def _light(facts: dict[str, Any]) -> str:
    if "brightness" not in facts:
        return ""
    return f"{facts['brightness']:.0f}, {facts['brightness_changes']:.0f}, {facts['contrast']:.0f}"
