# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam evaluate``: results against a reference."""

import argparse
import json
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from vislam_ros.cli.exit_codes import OK
from vislam_ros.data.evaluation.evaluate import evaluate_results

_ERRORS = (
    ("ate_m", "ATE, aligned [m]"),
    ("rpe_frame_m", "RPE, frame to frame [m]"),
    ("rpe_frame_deg", "RPE, frame to frame [deg]"),
    ("rpe_100m_m", "RPE over 100 m [m]"),
    ("rpe_100m_deg", "RPE over 100 m [deg]"),
)
_STATISTICS = ("rmse", "mean", "median", "max")


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    evaluation = evaluate_results(arguments.directory, arguments.reference)
    if arguments.json:
        print(json.dumps(evaluation, indent=2))
        return OK
    console = Console()
    for name in ("trajectory", "dead_reckoning", "smoothed"):
        if name in evaluation:
            console.print(_table(name, evaluation[name]))
    return OK


def _table(name: str, errors: Mapping[str, Any]) -> Table:
    title = f"{name}: {errors['poses']} poses"
    if errors.get("nees_per_dof") is not None:
        title += f", NEES/6 {errors['nees_per_dof']:.2f}"
    table = Table("", *_STATISTICS, title=title, title_justify="left")
    for key, label in _ERRORS:
        if errors.get(key):
            table.add_row(
                Text(label), *(f"{errors[key][statistic]:.4f}" for statistic in _STATISTICS)
            )
    return table
