# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands that estimate: run, solve, sweep."""

import argparse
from pathlib import Path

from vislam_ros.cli.grammar.argument_types import (
    assignment,
    name_or,
    number_from,
    whole_from,
)
from vislam_ros.cli.grammar.shared import (
    Commands,
    add_command,
    add_force,
    add_motion,
    add_namespace,
    add_rate,
    add_reading,
    add_remap,
    add_smooth,
    add_tracks,
)
from vislam_ros.core.filters.registry import estimator_names
from vislam_ros.core.settings import MOTION_SOURCES


def add_run(commands: Commands) -> None:
    """Add the command that runs the live graph."""
    parser = add_command(
        commands,
        "run",
        "run the whole live graph over a drive: its nodes and the player",
        """\
  vislam run drive.npz --out results              in real time, as on a car
  vislam run drive.npz --out results --rate 0     as fast as the graph takes it
  vislam run drive_bag --out results --params config/ekf.yaml --force
  vislam run fleet_bag --out results --namespace /robot1
  vislam run V1_01_easy --out results             images, through stereo_tracker_node
  vislam run drive.npz --out results --estimator localization --map before/landmarks.npz
  vislam run drive.npz --out results --view       in the Rerun viewer while it goes on

A terminal shows rate, latency, landmarks, position and verdict meanwhile. It says how to join its
graph. Without ROS_DOMAIN_ID it takes a domain that nobody uses, and without
ROS_AUTOMATIC_DISCOVERY_RANGE it is heard on this machine only. A node that dies or stands still
for a second ends it.
""",
    )
    _add_estimation(parser)
    add_tracks(parser, "track images first and play their tracks, which takes less room on disk")
    add_rate(parser)
    parser.add_argument(
        "--view",
        action="store_true",
        help="show it in the Rerun viewer meanwhile (pip install 'vislam_ros[view]')",
    )
    parser.add_argument(
        "--no-pictures",
        action="store_true",
        help="draw none, which ends two seconds sooner; `vislam plot` draws them later",
    )


def add_solve(commands: Commands) -> None:
    """Add the command that estimates offline."""
    parser = add_command(
        commands,
        "solve",
        "estimate offline, in one process, to the same last bit as the live graph",
        """\
  vislam solve drive.npz --out results
  vislam solve drive.npz --out results --smooth
  vislam solve drive_bag --out third --fraction 0.33 --seed 1
  vislam solve car_bag --out results --remap imu/twist:=/car/twist
  vislam solve drive.npz --out results --motion-source gyro     no velocity is needed
  vislam solve V1_01_easy --out results           an EuRoC folder: images and IMU
""",
    )
    _add_estimation(parser)
    add_smooth(parser)


def add_sweep(commands: Commands) -> None:
    """Add the command that solves with many settings."""
    parser = add_command(
        commands,
        "sweep",
        "solve a drive, or simulated ones, with every setting of a grid",
        """\
  vislam sweep drive.npz --out sweep --reference truth.tum \\
      --set slam_node.chi2_gate=9,16.27,25 --set slam_node.feature_fraction=0.33,0.5 --seeds 5
  vislam sweep --simulate --seeds 20 --out monte_carlo --set simulate.frozen_share=0,0.1
  vislam sweep --file sweep.yaml --out sweep --dask tcp://host:8786

The same command again does what is missing. A file holds data, reference, params, grid, seeds
and simulate, as below; its paths are relative to it, and flags go over it.
  grid: {slam_node.chi2_gate: [9, 16.27], slam_node.pixel_variance: [[1, 1, 1, 1], [9, 9, 9, 9]]}
  seeds: 5
  simulate: {steps: 300, frozen_share: 0.1}
""",
    )
    drive = parser.add_mutually_exclusive_group()
    drive.add_argument("data", metavar="DATA", type=Path, nargs="?", help="dataset or bag")
    drive.add_argument(
        "--simulate", action="store_true", help="simulate a drive for each seed instead"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="of the sweep")
    parser.add_argument("--file", type=Path, metavar="SWEEP.yaml", help="describes the sweep")
    add_motion(parser)
    parser.add_argument(
        "--set",
        type=assignment,
        action="append",
        default=[],
        metavar="NODE.NAME=V,...",
        help="values of a parameter, or of a simulate.NAME; one value is set and not swept",
    )
    parser.add_argument(
        "--seeds",
        type=whole_from(1),
        metavar="N",
        help="runs at each point: of the simulation, or of the choice of tracks (1)",
    )
    parser.add_argument("--reference", type=Path, metavar="REF.tum", help="the truth")
    parser.add_argument("--params", type=Path, metavar="FILE", help="what is not swept")
    parser.add_argument("--map", type=Path, metavar="FILE", help="for estimator localization")
    parser.add_argument("--jobs", type=whole_from(1), metavar="N", help="processes (all cores)")
    parser.add_argument("--dask", metavar="ADDRESS", help="run on this Dask cluster")
    add_smooth(parser)
    add_reading(parser)
    parser.add_argument("--force", action="store_true", help="begin anew, forgetting old runs")
    # What a run takes besides; here they are settings like others.
    parser.set_defaults(
        estimator=None, fraction=None, seed=None, motion_source=None, namespace="", remap=()
    )


def _add_estimation(parser: argparse.ArgumentParser) -> None:
    """Add what run and solve share."""
    parser.add_argument(
        "data",
        metavar="DATA_OR_BAG",
        type=Path,
        help="dataset or bag, or images as `vislam track` takes them",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="result directory")
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="ROS parameter file (config/ekf.yaml)"
    )
    names = estimator_names()
    parser.add_argument(
        "--estimator",
        type=name_or(names, ":", "module:Class of your own"),
        metavar="NAME",
        help=f"{', '.join(names)}, or module:Class of your own",
    )
    parser.add_argument(
        "--fraction", type=number_from(0, 1), metavar="F", help="share of the tracks to use (1)"
    )
    parser.add_argument(
        "--seed", type=whole_from(0), metavar="N", help="of the choice of tracks (0)"
    )
    parser.add_argument(
        "--map", type=Path, metavar="FILE", help="landmarks.npz for --estimator localization"
    )
    parser.add_argument(
        "--motion-source",
        choices=MOTION_SOURCES,
        help="what measures the motion: twists, the gyroscope alone, or (auto) twists where there "
        "are some",
    )
    add_motion(parser)
    add_reading(parser)
    add_namespace(
        parser,
        "namespace of one robot among others, such as /robot1: of its topics in the bag, and of "
        "the nodes that run",
    )
    add_remap(parser)
    add_force(parser)
