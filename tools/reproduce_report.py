#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw the report's figures 2 to 6 from a drive, and the recommended settings beside them.

tools/reproduce_report.py                          on a simulated drive
tools/reproduce_report.py drive.npz --reference truth.tum --out results/report --force
"""

import argparse
import dataclasses
import sys
from pathlib import Path

from report.experiments import (
    RECOMMENDED,
    TABLE_I,
    BaseSettings,
    run_experiments,
)
from report.figures import FIGURES, SHOWN, draw_figure

from vislam_ros.cli.exit_codes import FAILED, INTERRUPTED, OK
from vislam_ros.cli.grammar.shared import NO_OVERRIDES
from vislam_ros.cli.parameters import run_parameters, shared_file
from vislam_ros.cli.reading import read_input
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.reader import DEFAULT_RULES
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.files.whole_file import refuse_existing, replace_file
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.sweeps.plot import picture_bytes
from vislam_ros.data.sweeps.worker_pool import available_cores
from vislam_ros.data.trajectory import Trajectory, read_tum
from vislam_ros.errors import VislamError

# As the report's sequence: a clean twist with a gyroscope's bias, and frozen steps.
_SIMULATION = SimulationSettings(
    steps=900,
    landmarks=4000,
    velocity_noise_std=0.02,
    angular_velocity_noise_std=0.005,
    gyro_bias=(-0.01, -0.01, -0.01),
    frozen_share=0.15,
    seed=10,
)


def _settings() -> BaseSettings:
    """Settings of the two parameter files."""
    slam, prediction = {}, {}
    for base, file in ((TABLE_I, "report_table1.yaml"), (RECOMMENDED, "ekf.yaml")):
        path = shared_file(file)
        if path is None:
            raise VislamError(f"config/{file}: is not installed")
        parameters = run_parameters(argparse.Namespace(params=path, **NO_OVERRIDES))
        slam[base], prediction[base] = parameters.slam, parameters.prediction
    return BaseSettings(slam, prediction)


def _drive(arguments: argparse.Namespace) -> tuple[Drive, Trajectory | None]:
    """Read or simulate the drive, and its truth where it is known."""
    if arguments.data is None:
        per_step = _SIMULATION.landmarks / _SIMULATION.steps
        drive = simulate(
            dataclasses.replace(
                _SIMULATION,
                steps=arguments.steps,
                landmarks=max(round(per_step * arguments.steps), 1),
            )
        ).drive
    else:
        drive, *_ = read_input(arguments, DEFAULT_RULES)
    return drive, read_tum(arguments.reference) if arguments.reference else drive.ground_truth


def reproduce(arguments: argparse.Namespace) -> None:
    """Run the experiments, then write the pictures and their numbers."""
    for name in FIGURES:
        refuse_existing(arguments.out / f"{name}.png", force=arguments.force)
    drive, reference = _drive(arguments)
    with progress_bar("experiments", len(SHOWN)) as update:
        done: list[str] = []

        def count(name: str) -> None:
            done.append(name)
            update(len(done), name)

        results = run_experiments(drive, _settings(), SHOWN, arguments.jobs, count)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name, figure in FIGURES.items():
        picture = picture_bytes(draw_figure(figure, results, reference, drive.name))
        replace_file(arguments.out / f"{name}.png", picture)
        print(arguments.out / f"{name}.png")
    numbers = {name: results[name].figures(reference) for name in SHOWN}
    write_json(arguments.out / "report.json", {"drive": drive.name, "experiments": numbers})


def main() -> int:
    """Run the tool and return its exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", metavar="DATA_OR_BAG", type=Path, nargs="?")
    parser.add_argument("--reference", type=Path, metavar="REF.tum", help="the truth")
    parser.add_argument("--out", type=Path, default=Path("results/report"), metavar="DIR")
    parser.add_argument("--steps", type=int, default=_SIMULATION.steps, help="to simulate")
    parser.add_argument("--jobs", type=int, default=available_cores(), help="processes")
    parser.add_argument("--force", action="store_true", help="replace figures that exist")
    parser.set_defaults(
        imu_frame="auto", twist_index="auto", twist_origin="auto", extrinsics="auto"
    )
    parser.set_defaults(format=None, namespace="", remap=(), motion=None)
    try:
        reproduce(parser.parse_args())
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    return OK


if __name__ == "__main__":
    sys.exit(main())
