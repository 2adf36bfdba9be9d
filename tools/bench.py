#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How fast and how good the filter is, beside the floor under it and beside its peers.

BLAS has one thread. Times are processor time of the thread that works, so that others on the
machine disturb them less; what is compared is measured in turn.
"""

import argparse
import dataclasses
import os
import sys
import tempfile
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import threadpoolctl
from benchmark import step_times
from benchmark.battery.ablation import measure_ablation
from benchmark.battery.measuring import measure_battery
from benchmark.battery.rows import all_rows, quick_rows
from benchmark.battery.trials import TrialSettings
from benchmark.bench_arguments import ABLATION, BATTERY, bench_parser
from benchmark.consistency.noise_redrawn import redraw
from benchmark.consistency.simulated_drives import CELLS, SMALL_DISPARITY, MonteCarlo
from benchmark.consistency.track_errors import disparity_errors
from benchmark.drive_times import solve_as_command, solve_here
from benchmark.frontend.image_sets import image_sets
from benchmark.frontend.stage_times import measure_frontend
from benchmark.machine import describe_machine
from benchmark.peers.comparison import PeerComparison
from benchmark.peers.gtsam_runs import gtsam_is_installed
from benchmark.recorded_drive import first_steps
from benchmark.report_table import print_report

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.cli.parameters import run_parameters
from vislam_ros.core.filters.registry import estimator_named
from vislam_ros.core.filters.settings import ObservationSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.files.whole_file import refuse_existing
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
Report = dict[str, Any]


class LeftOut(Exception):
    """Why a section cannot be measured."""


class Bench:
    """Measures section by section; the drive is read or simulated when one first needs it.

    Parameters
    ----------
    arguments : Namespace
        Of the command line.
    folder : Path
        For a drive that is simulated.

    Attributes
    ----------
    notes : list of str
        What a reader of the report should know.
    """

    def __init__(self, arguments: argparse.Namespace, folder: Path):
        self._arguments = arguments
        self._quick: bool = arguments.quick
        self._folder = folder
        parameters = run_parameters(arguments)
        self._settings = parameters.slam, parameters.prediction
        self.slam = parameters.slam
        self.notes: list[str] = []
        self._effort = step_times.Effort(rounds=3, block=3) if self._quick else step_times.Effort()
        seeds = arguments.seeds
        self._seeds = range(min(seeds, 2) if self._quick else seeds)

    def floor(self) -> Report:
        """Steps with 66 and 150 landmarks in view, in turn with the bare LAPACK calls."""
        rows = [
            step_times.above_the_floor(self.slam, active, self._effort, turnover=turnover)
            for active in (66, 150)
            for turnover in (False, True)
        ]
        return {"floor": rows}

    def dense(self) -> Report:
        """The dense filter over 500, 1000 and 2000 landmarks, in turn with the step."""
        sizes = (500,) if self._quick else (500, 1000, 2000)
        return {"dense": step_times.beside_the_dense_filter(self.slam, 66, sizes, self._effort)}

    def growth(self) -> Report:
        """The step as the map grows to 13289 landmarks, and as the view grows."""
        counts = (20, 100) if self._quick else (20, 40, 66, 100, 150, 200)
        return {
            "map_growth": step_times.growth_with_the_map(
                self.slam, 66, (500, 2000, 13289), self._effort
            ),
            "view_growth": [
                step_times.above_the_floor(self.slam, active, self._effort, turnover=True)
                for active in counts
            ],
        }

    def drives(self) -> Report:
        """A whole drive, inside this process and as a command with its peak memory."""
        data, reference_path = self._files
        options = ["--estimator", self.slam.estimator]
        if self._arguments.params:
            options += ["--params", str(self._arguments.params)]
        rows = [
            solve_here(self._drive, *self._settings, self._reference),
            solve_as_command(data, options, reference_path),
        ]
        if estimator_named(self.slam.estimator).smoothable:
            rows.append(solve_as_command(data, [*options, "--smooth"], reference_path))
        return {"data": self._drive.name, "drives": rows}

    def peers(self) -> Report:
        """GTSAM's iSAM2, fixed lag and batch optimum on the same tracks, whole and first steps."""
        reference = self._needed_reference
        if not gtsam_is_installed():
            self.notes.append("GTSAM is not installed: pip install gtsam to have the peers")

        def compared(drive: Drive, *, every: bool) -> Report:
            say = self._progress("peers")
            return PeerComparison(drive, reference, *self._settings, on_progress=say).run(
                every=every
            )

        report: Report = {"data": self._drive.name}
        if not self._quick:
            report["peers"] = compared(self._drive, every=False)
        steps: int = self._arguments.peer_steps
        beginning = first_steps(self._drive, min(steps, 150) if self._quick else steps)
        return {**report, "peers_first_steps": compared(beginning, every=True)}

    def consistency(self) -> Report:
        """Consistency (NEES) and optimality (ATE beside the batch's) on simulated drives."""
        cells = CELLS
        if self._quick:
            cells = tuple(dataclasses.replace(cell, steps=30, landmarks=150) for cell in CELLS)
        monte_carlo = MonteCarlo(*self._settings, on_progress=self._progress("consistency"))
        consistency = monte_carlo.run(self._seeds, cells)
        unfinished = sum(not drive["converged"] for drive in consistency["drives"])
        if unfinished:
            self.notes.append(
                f"consistency: batches of {unfinished} drives did not reach their end"
            )
        disparities = consistency["disparities"]
        self.notes.append(
            f"disparities of consistency: median {disparities['median_px']:.2f} px, a twentieth "
            f"under {disparities['twentieth_px']:.2f} px, {disparities['small_share']:.1%} under "
            f"{SMALL_DISPARITY} px; {consistency['seeds']} drives of each kind"
        )
        return {"consistency": consistency}

    def tracks(self) -> Report:
        """Errors of a drive's disparities: their size, and how little they change on a track."""
        slam, prediction = self._settings
        if not (
            estimator_named(slam.estimator).smoothable and isinstance(slam, ObservationSettings)
        ):
            raise LeftOut(f"{slam.estimator} cannot be smoothed")
        errors = disparity_errors(self._drive, slam, prediction)
        return {"data": self._drive.name, "tracks": errors}

    def redrawn(self) -> Report:
        """Consistency on a drive, and on the same with the noise of tracks and twists redrawn."""
        redrawn = redraw(
            *(self._drive, self._needed_reference, *self._settings, self._seeds),
            on_progress=self._progress("redrawn"),
        )
        return {"data": self._drive.name, "redrawn": redrawn}

    def frontend(self) -> Report:
        """The front end's stages beside bare OpenCV calls, and the quality of its tracks."""
        frames, repeats = (6, 1) if self._quick else (51, 3)
        return measure_frontend(image_sets(SHARED_DATA, frames), repeats)

    def battery(self) -> Report:
        """Errors on many kinds of drives; half an hour, and only where it is named."""
        slam, prediction = self._settings
        smooth = estimator_named(slam.estimator).smoothable
        battery = measure_battery(
            self._arguments.out.parent / BATTERY,
            quick_rows() if self._quick else all_rows(),
            TrialSettings(SHARED_DATA, slam, prediction, smooth),
            seeds=1 if self._quick else self._arguments.battery_seeds,
            jobs=self._arguments.jobs,
            force=self._arguments.force,
            beside=self._arguments.beside,
        )
        self.notes += battery.notes
        return {"battery": battery.rows, "battery_groups": battery.groups}

    def ablation(self) -> Report:
        """The battery without each mechanism, unsmoothed; an hour, and only where it is named."""
        ablation, notes = measure_ablation(
            self._arguments.out.parent / ABLATION,
            quick_rows() if self._quick else all_rows(),
            TrialSettings(SHARED_DATA, *self._settings, smooth=False),
            seeds=1,
            jobs=self._arguments.jobs,
            force=self._arguments.force,
        )
        self.notes += notes
        return {"ablation": ablation}

    @cached_property
    def _files(self) -> tuple[Path, Path | None]:
        """Dataset and reference: those given, the long drive, or one that is simulated."""
        data = self._arguments.data or (LONG_DRIVE if LONG_DRIVE.is_file() else None)
        if data is None:
            _say("simulating a drive")
            data = self._folder / "simulated.npz"
            return data, write_simulated(data, simulate(SIMULATED))
        name = f"{data.stem}.tum"
        beside = [data.with_name(name), data.parent / "ground_truth" / name]
        return data, self._arguments.reference or next(filter(Path.is_file, beside), None)

    @cached_property
    def _drive(self) -> Drive:
        return load_drive(self._files[0])

    @cached_property
    def _reference(self) -> Trajectory | None:
        path = self._files[1]
        return read_tum(path) if path else None

    @property
    def _needed_reference(self) -> Trajectory:
        if self._reference is None:
            raise LeftOut("it needs --reference for its errors")
        return self._reference

    def _progress(self, section: str) -> Callable[[str], None]:
        return lambda what: _say(f"{section}: {what}")


SECTIONS: dict[str, Callable[[Bench], Report]] = {
    "floor": Bench.floor,
    "dense": Bench.dense,
    "growth": Bench.growth,
    "drives": Bench.drives,
    "peers": Bench.peers,
    "consistency": Bench.consistency,
    "tracks": Bench.tracks,
    "redrawn": Bench.redrawn,
    "frontend": Bench.frontend,
    "battery": Bench.battery,
    "ablation": Bench.ablation,
}


def main(argv: list[str] | None = None) -> int:
    """Measure, print and write; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        refuse_existing(arguments.out, force=arguments.force)
        report = measure(arguments)
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        write_json(arguments.out, report)
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        _say("interrupted: the battery's rows are kept, and the same call goes on")
        return INTERRUPTED
    print_report(report)
    print(f"written to {arguments.out}")
    return OK


def measure(arguments: argparse.Namespace) -> Report:
    """Measure the sections that were asked for."""
    with threadpoolctl.threadpool_limits(1), tempfile.TemporaryDirectory() as folder:
        bench = Bench(arguments, Path(folder))
        report: Report = {
            "machine": describe_machine(),
            "clock": "one BLAS thread; processor time of the thread that works, medians",
            "estimator": bench.slam.estimator,
            "settings": dataclasses.asdict(bench.slam),
            "notes": bench.notes,
        }
        for name, section in SECTIONS.items():
            if name in arguments.only:
                _say(name)
                try:
                    report |= section(bench)
                except LeftOut as why:
                    bench.notes.append(f"{name} is left out: {why}")
    return report


def _say(what: str) -> None:
    print(what, file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    return bench_parser(
        __doc__, {name: section.__doc__ or "" for name, section in SECTIONS.items()}
    )


if __name__ == "__main__":
    sys.exit(main())
