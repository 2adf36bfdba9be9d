# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the running graph takes in real time: rates, latencies of the hops, CPU.

tools/faults.py load drive.npz
tools/faults.py load drive.npz --features 30 120 500 --rates 10 30 --seconds 3
"""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmark.machine import describe_machine

from reliability.load.curve import CurvePoint, largest_rates, measure_features
from reliability.load.latency import Percentiles, hops
from reliability.load.pace import paced_steps
from reliability.load.pictures import draw_curve
from reliability.load.play import play_heard
from reliability.output import add_output, write_output
from vislam_ros.cli.exit_codes import OK
from vislam_ros.data.conversion import convert
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.loading import load_drive

_OUT = Path("results") / "load.json"
_FEATURES = [30, 60, 120, 250, 500, 1000]
_RATES = [10.0, 20.0, 30.0, 60.0, 100.0]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    add = parser.add_argument
    add("data", type=Path, metavar="DATA", help="a drive for the latencies at rate 1")
    add("--features", nargs="*", type=int, default=_FEATURES, help="in a frame, about")
    add("--rates", nargs="+", type=float, default=_RATES, help="frames a second")
    add("--seconds", type=float, default=5.0, help="of each point of the curve (5)")
    add("--drive-seconds", type=float, default=30.0, help="of DATA (30)")
    add_output(parser, _OUT, "with a .png beside it")


def run_command(arguments: argparse.Namespace) -> int:
    """Measure, and print three tables."""
    picture = arguments.out.with_suffix(".png")
    for file in (arguments.out, picture):
        refuse_existing(file, force=arguments.force)
    content: dict[str, Any] = {"machine": describe_machine()}
    points: list[CurvePoint] = []
    with tempfile.TemporaryDirectory(prefix="vislam_load_") as scratch:
        bag = Path(scratch) / "drive"
        convert(arguments.data, bag)
        played = play_heard(bag, Path(scratch) / "run", 1.0, arguments.drive_seconds)
        latencies = hops(played.messages)
        latencies |= paced_steps(load_drive(arguments.data), arguments.drive_seconds)
        content["hops_ms"] = {name: vars(value) for name, value in latencies.items()}
        content["cpu"] = played.cpu
        print_hops(latencies)
        print_cpu(played.cpu)
        for features in arguments.features:
            points += measure_features(features, arguments.rates, arguments.seconds, Path(scratch))
            print(f"{features} features", end="\r", file=sys.stderr)
    content["curve"] = [point.as_dict() for point in points]
    write_output(arguments.out, content)
    if points:
        replace_file(picture, draw_curve(points))
        print_curve(points)
    return OK


def print_hops(latencies: dict[str, Percentiles]) -> None:
    """A line for each hop."""
    print("| hop, ms | p50 | p99 | max | messages |")
    print("|---|---|---|---|---|")
    for name, value in latencies.items():
        print(
            f"| {name} | {value.p50:.2f} | {value.p99:.2f} | {value.largest:.2f} | {value.count} |"
        )


def print_cpu(shares: dict[str, float]) -> None:
    """A line for each process."""
    print("\n| process | share of a core |\n|---|---|")
    for name, share in shares.items():
        print(f"| {name} | {100 * share:.1f} % |")


def print_curve(points: list[CurvePoint]) -> None:
    """A line for each number of features, a column for each rate: latency at the end."""
    rates = sorted({point.rate for point in points})
    told = {(point.features, point.rate): point for point in points}
    print(f"\n| features | bytes | largest | {' | '.join(f'{rate:g} Hz' for rate in rates)} |")
    print("|---" * (len(rates) + 3) + "|")
    for features, largest in largest_rates(points).items():
        size = next(point.size for point in points if point.features == features)
        cells = [_cell(told.get((features, rate))) for rate in rates]
        print(f"| {features:g} | {size:.0f} | {largest:g} Hz | {' | '.join(cells)} |")


def _cell(point: CurvePoint | None) -> str:
    if point is None:
        return ""
    return f"{point.latency_ms:.1f} ms{'' if point.keeps_up else ', falls behind'}"
