# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The drive that a command is given, with progress and the reader's notes."""

import argparse

from vislam_ros.cli.lines import tell
from vislam_ros.cli.played_bag import renamed_topics
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.reader import ReadingRules
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.datasets.formats import import_format
from vislam_ros.data.drive import Drive
from vislam_ros.data.inspection.right_camera import judge_pairs
from vislam_ros.data.loading import load_passes
from vislam_ros.frontend.settings import TrackerSettings


def read_input(
    arguments: argparse.Namespace, rules: ReadingRules, tracker: TrackerSettings | None = None
) -> tuple[Drive, ...]:
    """Read the data that a command is given, pass by pass, and tell what was repaired."""
    use_format(arguments)
    with progress_bar("reading", 1.0) as update:
        passes = load_passes(
            arguments.data,
            conventions=conventions(arguments),
            rules=rules,
            topics=renamed_topics(arguments),
            namespace=arguments.namespace,
            motion=arguments.motion,
            tracker=tracker,
            progress=lambda share: update(share, ""),
        )
    print_notes(passes[0])
    return passes


def use_format(arguments: argparse.Namespace) -> None:
    """Make known the format that ``--format`` names."""
    if arguments.format:
        import_format(arguments.format)


def conventions(arguments: argparse.Namespace) -> Conventions:
    """What the arguments say of the meaning of a dataset's numbers."""
    return Conventions(
        arguments.imu_frame, arguments.twist_index, arguments.twist_origin, arguments.extrinsics
    )


def print_notes(drive: Drive) -> None:
    """Print what the reader repaired or left out, and what is wrong with its pairs."""
    for note in (*drive.notes, *(finding.note for finding in judge_pairs(drive))):
        tell(f"note: {note}")
