# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line of tools/bench.py."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from vislam_ros.cli.grammar.shared import NO_OVERRIDES
from vislam_ros.core.filters.registry import estimator_names
from vislam_ros.data.sweeps.worker_pool import available_cores

OUT = Path("results/bench.json")
#: Sections that take long, each the name of the folder beside ``OUT`` that keeps its rows.
ON_REQUEST = BATTERY, ABLATION = "battery", "ablation"


def bench_parser(description: str | None, sections: Mapping[str, str]) -> argparse.ArgumentParser:
    """Make the parser, for sections by their names with a line about each."""
    width = max(map(len, sections))
    lines = [f"  {name:{width}}  {text}" for name, text in sections.items()]
    parser = argparse.ArgumentParser(
        description=description,
        epilog="\n".join(["sections:", *lines]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add: Callable[..., Any] = parser.add_argument
    add(
        "--only",
        type=_names_of(sections),
        default=[name for name in sections if name not in ON_REQUEST],
        metavar="SECTION,SECTION",
        help="these sections, as named below (all but battery and ablation)",
    )
    add("--quick", action="store_true", help="fewer repeats and sizes, to see that all works")
    add("--data", type=Path, metavar="FILE", help="dataset or bag, for what needs a drive")
    add("--reference", type=Path, metavar="REF.tum", help="its reference, if not beside it")
    add(
        "--peer-steps",
        type=int,
        default=1000,
        metavar="N",
        help="first steps of the drive with which every peer runs (1000); a few run whole",
    )
    add(
        "--seeds",
        type=int,
        default=20,
        metavar="N",
        help="drives of each kind, for consistency and redrawn (20)",
    )
    add(
        "--battery-seeds",
        type=int,
        default=3,
        metavar="N",
        help="subsets of tracks or draws of noise of each of the battery's rows (3)",
    )
    add(
        "--beside",
        type=Path,
        metavar="DIR",
        help="the battery's folder of another run, whose errors are put beside",
    )
    add(
        "--jobs",
        type=int,
        default=available_cores(),
        metavar="N",
        help="of battery and ablation (all cores)",
    )
    add("--params", type=Path, metavar="FILE", help="ROS parameter file (config/ekf.yaml)")
    add("--estimator", choices=estimator_names())
    add(
        "--out",
        type=Path,
        default=OUT,
        metavar="FILE",
        help=f"({OUT}); the battery's rows, table.md and battery.png lie in {BATTERY}/ beside it, "
        "and an interrupted battery goes on from there",
    )
    add(
        "--force",
        action="store_true",
        help="replace FILE, and a battery's rows of other settings or code",
    )
    parser.set_defaults(**NO_OVERRIDES)
    return parser


def _names_of(sections: Mapping[str, str]) -> Callable[[str], list[str]]:
    def names(text: str) -> list[str]:
        chosen = text.split(",")
        if not set(chosen) <= set(sections):
            raise argparse.ArgumentTypeError(f"{text}: name some of {', '.join(sections)}")
        return chosen

    return names
