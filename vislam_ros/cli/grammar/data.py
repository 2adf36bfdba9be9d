# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands that make data and look at them: simulate, inspect, track, convert."""

from pathlib import Path

from vislam_ros.cli.grammar.argument_types import number_from, whole_from
from vislam_ros.cli.grammar.shared import (
    NO_OVERRIDES,
    SCENES,
    Commands,
    add_command,
    add_force,
    add_motion,
    add_namespace,
    add_reading,
    add_remap,
    add_tracks,
)


def add_simulate(commands: Commands) -> None:
    """Add the command that writes a simulated drive."""
    parser = add_command(
        commands,
        "simulate",
        "write a simulated drive with exact ground truth beside it, as tracks or as stereo images",
        """\
  vislam simulate drive.npz
  vislam simulate hard.npz --steps 500 --outliers 0.05 --frozen 0.1 --gyro-bias -0.01 -0.01 -0.01
  vislam simulate again.npz --along reference.tum --landmarks 4000
  vislam simulate city --images --seconds 10 --exposure --blur 0.01
  vislam simulate hall --images --scene room --rectified --moving 0
""",
    )
    parser.add_argument(
        "output",
        metavar="OUT",
        type=Path,
        help="OUT.npz, beside which OUT.tum is written; with --images a folder",
    )
    parser.add_argument(
        "--along",
        type=Path,
        metavar="REF.tum",
        help="drive along these poses of a body (x forward), at their times, to their end",
    )
    # What is not given is left to the simulation's own defaults, which the texts repeat.
    flags = {"scene": "--scene"}
    images = parser.add_argument_group(
        "stereo images", "an EuRoC/ASL folder with images, IMU and truth, in place of tracks"
    )
    images.add_argument("--images", action="store_true", help="draw images")
    images.add_argument(
        "--scene", choices=SCENES, help="a drive along a street, or a flight in a room (street)"
    )
    for flag, name, kind, metavar, text in (
        ("--seconds", "seconds", number_from(0.1), "S", "duration, as far as --along goes (20)"),
        ("--rate", "rate", number_from(0.5, 200), "HZ", "stereo frames a second (20)"),
        ("--moving", "moving_objects", whole_from(0), "N", "cars or boxes that move (3)"),
        ("--blur", "exposure_time", number_from(0, 0.1), "S", "exposure time of an image (0)"),
    ):
        images.add_argument(flag, dest=name, type=kind, metavar=metavar, help=text)
        flags[name] = flag
    for flag, name, text in (
        ("--exposure", "exposure_changes", "let the exposure wander, and err for a while"),
        ("--rectified", "rectified", "draw without lenses, by two parallel cameras"),
    ):
        images.add_argument(flag, dest=name, action="store_true", default=None, help=text)
        flags[name] = flag
    for flag, name, kind, metavar, text in (
        ("--steps", "steps", whole_from(2), "N", "feature frames, ten a second (600)"),
        ("--landmarks", "landmarks", whole_from(1), "N", "tracks in the whole drive (3000)"),
        ("--pixel-noise", "pixel_noise_std", number_from(0), "PX", "white noise (1)"),
        (
            "--disparity-offset",
            "disparity_offset_std",
            number_from(0),
            "PX",
            "error of a disparity that stays for the life of its track (0)",
        ),
        ("--velocity-noise", "velocity_noise_std", number_from(0), "M/S", "of a sample (0.1)"),
        (
            "--angular-velocity-noise",
            "angular_velocity_noise_std",
            number_from(0),
            "RAD/S",
            "of a sample (0.01)",
        ),
        ("--outliers", "outlier_share", number_from(0, 1), "SHARE", "of sliding tracks (0.03)"),
        (
            "--frozen",
            "frozen_share",
            number_from(0, 0.5),
            "SHARE",
            "of steps at which old tracks repeat their pixels (0)",
        ),
        ("--seed", "seed", whole_from(0), "N", "of everything random (0)"),
    ):
        parser.add_argument(flag, dest=name, type=kind, metavar=metavar, help=text)
        flags[name] = flag
    parser.add_argument(
        "--gyro-bias",
        type=number_from(),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="constant error of the angular velocity, rad/s (0.002 0.002 0.002)",
    )
    add_force(parser)
    parser.set_defaults(flags=flags)


def add_inspect(commands: Commands) -> None:
    """Add the command that tells what data are."""
    parser = add_command(
        commands,
        "inspect",
        "tell what a dataset, a bag or images are, and what is wrong with them",
        """\
  vislam inspect drive.npz
  vislam inspect drive_bag --json > drive.json
  vislam inspect V1_01_easy
  vislam inspect sequences/06 --motion 0020.npz

Each finding is a line on what was found and one on what to do (docs/inspect.md). 0 is returned
where the data can be used, whatever is found.
""",
    )
    parser.add_argument(
        "data", metavar="DATA", type=Path, help="dataset, bag, or images as `vislam track` takes"
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of the tables")
    add_motion(parser)
    add_reading(parser)
    add_namespace(parser, "namespace of one robot among others in a bag, such as /robot1")
    add_remap(parser)
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="what solve is to read a bag with"
    )
    parser.set_defaults(**NO_OVERRIDES)


def add_track(commands: Commands) -> None:
    """Add the command that makes tracks of images."""
    parser = add_command(
        commands,
        "track",
        "track features through stereo images, for solve, run and convert",
        """\
  vislam track V1_01_easy tracks.npz                       EuRoC/ASL: mav0 with cam0, cam1, imu0
  vislam track 2011_09_30_drive_0020_sync tracks.npz       KITTI raw: image_00, image_01, oxts
  vislam track sequences/06 tracks.npz --motion 0020.npz   KITTI odometry: image_0, image_1
  vislam track dataset00_imgs.npy tracks.npz               beside dataset00.npy
  vislam track car_bag tracks.npz --remap imu/data:=/camera/imu
""",
    )
    parser.add_argument(
        "data",
        metavar="IMAGES",
        type=Path,
        help="EuRoC/ASL or KITTI folder, course file with its _imgs.npy, or bag with images",
    )
    parser.add_argument("output", metavar="OUT.npz", type=Path, help="dataset of tracks to make")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="draw the tracks in the middle image"
    )
    add_motion(parser)
    add_reading(parser)
    add_namespace(parser, "namespace of one robot among others in a bag, such as /robot1")
    add_remap(parser)
    add_force(parser)


def add_convert(commands: Commands) -> None:
    """Add the command that writes a bag."""
    parser = add_command(
        commands,
        "convert",
        "write a dataset or images as an MCAP bag",
        """\
  vislam convert drive.npz drive_bag
  vislam convert 03.npz 03_bag --imu-frame flu --reference 03.tum --force
  vislam convert V1_01_easy v1_bag                images, for the live graph with its tracker
  vislam convert V1_01_easy v1_tracks --tracks    tracks of them, which is smaller
""",
    )
    parser.add_argument(
        "data",
        metavar="DATA",
        type=Path,
        help=".npz or .npy dataset, or images as `vislam track` takes them",
    )
    parser.add_argument("output", metavar="OUT", type=Path, help="bag directory to make")
    add_motion(parser)
    add_tracks(parser, "write the tracks of images, and not the images themselves")
    add_reading(parser)
    parser.add_argument(
        "--reference", type=Path, metavar="REF.tum", help="becomes ground_truth/odometry"
    )
    add_force(parser)
