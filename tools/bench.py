#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How fast and how good the filter is, beside the floor under it and beside its peers.

  a  the step with 66 and 150 landmarks in view, and in turn with it the bare LAPACK calls
  b  the dense filter over 500, 1000 and 2000 landmarks, and in turn with it the step
  c  the step as the map grows to 13289 landmarks, and as the view grows
  d  a whole drive, inside this process and as a command with its peak memory
  e  GTSAM's iSAM2, fixed-lag smoother and batch optimum on the same tracks, over the whole drive
     and, with what is too slow for that, over its first steps
  f  consistency (NEES) and optimality (ATE beside the batch optimum's) on simulated drives
  g  the errors of a drive's disparities: their size, and how little they change along a track
  h  consistency on a drive, and on the same with the noise of its tracks and twists drawn anew

BLAS has one thread. Times are processor time of the thread that works, so that others on the
machine disturb them less; what is compared is measured in turn.
"""

import argparse
import dataclasses
import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import threadpoolctl
from benchmark import step_times
from benchmark.consistency.noise_redrawn import redraw
from benchmark.consistency.simulated_drives import CELLS, SMALL_DISPARITY, MonteCarlo
from benchmark.consistency.track_errors import disparity_errors
from benchmark.drive_times import solve_as_command, solve_here
from benchmark.machine import describe_machine
from benchmark.peers.comparison import PeerComparison
from benchmark.peers.gtsam_runs import gtsam_is_installed
from benchmark.recorded_drive import first_steps
from benchmark.report_table import print_report

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.parameters import RunParameters, run_parameters
from vislam_ros.core.filters.registry import estimator_named, estimator_names
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.loading import load_drive
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.trajectory import Trajectory, read_tum
from vislam_ros.errors import VislamError

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED_DATA = Path(os.environ.get("VISLAM_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
LONG_DRIVE = SHARED_DATA / "10_synthetic.npz"

# Where there is no such drive, one that is much like it.
SIMULATED = SimulationSettings(
    steps=3026,
    landmarks=13289,
    velocity_noise_std=0.02,
    angular_velocity_noise_std=0.005,
    gyro_bias=(-0.01, -0.01, -0.01),
    frozen_share=0.147,
)
SECTIONS = "abcdefgh"


def main(argv: list[str] | None = None) -> int:
    """Measure, print and write; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        refuse_existing(arguments.out, force=arguments.force)
        report = measure(arguments)
        content = json.dumps(report, indent=2) + "\n"
        replace_file(arguments.out, content.encode("utf-8"))
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    print_report(report)
    print(f"written to {arguments.out}")
    return OK


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure the sections that were asked for."""
    parameters = run_parameters(arguments)
    effort = step_times.Effort(rounds=3, block=3) if arguments.quick else step_times.Effort()
    with threadpoolctl.threadpool_limits(1):
        report: dict[str, Any] = {
            "machine": describe_machine(),
            "clock": "one BLAS thread; processor time of the thread that works, medians",
            "estimator": parameters.slam.estimator,
            "settings": dataclasses.asdict(parameters.slam),
            "notes": [],
        }
        slam = parameters.slam
        if "a" in arguments.only:
            _say("a: the step and the LAPACK floor")
            report["floor"] = [
                step_times.above_the_floor(slam, active, effort, turnover=turnover)
                for active in (66, 150)
                for turnover in (False, True)
            ]
        if "b" in arguments.only:
            _say("b: the dense filter")
            sizes = (500,) if arguments.quick else (500, 1000, 2000)
            report["dense"] = step_times.beside_the_dense_filter(slam, 66, sizes, effort)
        if "c" in arguments.only:
            _say("c: growth")
            report["map_growth"] = step_times.growth_with_the_map(
                slam, 66, (500, 2000, 13289), effort
            )
            counts = (20, 100) if arguments.quick else (20, 40, 66, 100, 150, 200)
            report["view_growth"] = [
                step_times.above_the_floor(slam, active, effort, turnover=True)
                for active in counts
            ]
        if set("degh") & set(arguments.only):
            _measure_drive(arguments, parameters, report)
        if "f" in arguments.only:
            _measure_consistency(arguments, parameters, report)
    return report


def _measure_consistency(
    arguments: argparse.Namespace, parameters: RunParameters, report: dict[str, Any]
) -> None:
    monte_carlo = MonteCarlo(
        parameters.slam, parameters.prediction, on_progress=lambda what: _say(f"f: {what}")
    )
    cells = CELLS
    if arguments.quick:
        cells = tuple(dataclasses.replace(cell, steps=30, landmarks=150) for cell in CELLS)
    consistency = monte_carlo.run(_seeds(arguments), cells)
    disparities = consistency["disparities"]
    report["consistency"] = consistency
    unfinished = sum(not drive["converged"] for drive in consistency["drives"])
    if unfinished:
        report["notes"].append(f"f: batches of {unfinished} drives did not reach their end")
    report["notes"].append(
        f"disparities of f: median {disparities['median_px']:.2f} px, a twentieth under "
        f"{disparities['twentieth_px']:.2f} px, {disparities['small_share']:.1%} under "
        f"{SMALL_DISPARITY} px; {consistency['seeds']} drives of each kind"
    )


def _measure_drive(
    arguments: argparse.Namespace, parameters: RunParameters, report: dict[str, Any]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        data, reference_path = _drive_files(arguments, Path(folder))
        drive = load_drive(data)
        reference = read_tum(reference_path) if reference_path else None
        report["data"] = drive.name
        smoothable = estimator_named(parameters.slam.estimator).smoothable
        if not smoothable and set("dg") & set(arguments.only):
            report["notes"].append(
                f"{parameters.slam.estimator} cannot be smoothed: what needs it is left out"
            )
        if "d" in arguments.only:
            _say(f"d: {data.name}, whole")
            rows = [solve_here(drive, parameters.slam, parameters.prediction, reference)]
            options = ["--estimator", parameters.slam.estimator]
            if arguments.params:
                options += ["--params", str(arguments.params)]
            rows.append(solve_as_command(data, options, reference_path))
            if smoothable:
                rows.append(solve_as_command(data, [*options, "--smooth"], reference_path))
            report["drive"] = rows
        if "g" in arguments.only and smoothable:
            _say(f"g: the tracks of {data.name}")
            report["disparity_errors"] = disparity_errors(
                drive, parameters.slam, parameters.prediction
            )
        if set("eh") & set(arguments.only) and reference is None:
            report["notes"].append("e and h need --reference for their errors: left out")
        if reference is None:
            return
        if "h" in arguments.only:
            report["redrawn"] = redraw(
                drive,
                reference,
                parameters.slam,
                parameters.prediction,
                _seeds(arguments),
                on_progress=lambda what: _say(f"h: {what}"),
            )
        if "e" not in arguments.only:
            return
        if not gtsam_is_installed():
            report["notes"].append("GTSAM is not installed: pip install gtsam to have the peers")
        if not arguments.quick:
            whole = _peer_comparison(drive, reference, parameters)
            report["peers"] = whole.run(every=False)
        steps = min(arguments.peer_steps, 150) if arguments.quick else arguments.peer_steps
        beginning = _peer_comparison(first_steps(drive, steps), reference, parameters)
        report["peers_first_steps"] = beginning.run()


def _peer_comparison(
    drive: Drive, reference: Trajectory, parameters: RunParameters
) -> PeerComparison:
    return PeerComparison(
        drive,
        reference,
        parameters.slam,
        parameters.prediction,
        on_progress=lambda what: _say(f"e: {what}"),
    )


def _drive_files(arguments: argparse.Namespace, folder: Path) -> tuple[Path, Path | None]:
    """Dataset and reference: those given, the long drive of the shared data, or a simulation."""
    data = arguments.data or (LONG_DRIVE if LONG_DRIVE.is_file() else None)
    if data is None:
        _say("simulating a drive")
        data = folder / "simulated.npz"
        return data, write_simulated(data, simulate(SIMULATED))
    name = f"{data.stem}.tum"
    beside = [data.with_name(name), data.parent / "ground_truth" / name]
    return data, arguments.reference or next(filter(Path.is_file, beside), None)


def _seeds(arguments: argparse.Namespace) -> range:
    """Seeds of f and h."""
    return range(min(arguments.seeds, 2) if arguments.quick else arguments.seeds)


def _say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def _sections(text: str) -> set[str]:
    sections = set(text.replace(",", ""))
    if not sections or sections - set(SECTIONS):
        raise argparse.ArgumentTypeError(f"{text}: name some of {', '.join(SECTIONS)}")
    return sections


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add: Callable[..., Any] = parser.add_argument
    add("--only", type=_sections, default=set(SECTIONS), metavar="a,c", help="these sections")
    add("--quick", action="store_true", help="fewer repeats and sizes, to see that all works")
    add("--data", type=Path, metavar="FILE", help="dataset or bag of d, e, g and h")
    add("--reference", type=Path, metavar="REF.tum", help="its reference, if not beside it")
    add(
        "--peer-steps",
        type=int,
        default=1000,
        metavar="N",
        help="first steps of the drive with which e runs every peer (1000); a few run whole",
    )
    add("--seeds", type=int, default=20, metavar="N", help="drives of each kind, for f and h (20)")
    add("--params", type=Path, metavar="FILE", help="ROS parameter file (config/ekf.yaml)")
    add("--estimator", choices=estimator_names())
    add("--out", type=Path, default=Path("bench.json"), metavar="FILE", help="(bench.json)")
    add("--force", action="store_true", help="replace FILE")
    parser.set_defaults(fraction=None, seed=None, map=None)
    return parser


if __name__ == "__main__":
    sys.exit(main())
