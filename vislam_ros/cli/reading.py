# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The drive that a command is given, with progress and the reader's notes."""

import argparse
import sys

from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.drive import Drive
from vislam_ros.data.loading import load_drive


def read_input(arguments: argparse.Namespace) -> Drive:
    """Read the dataset or bag ``DATA_OR_BAG`` and tell what was repaired."""
    with progress_bar("reading", 1.0) as update:
        drive = load_drive(
            arguments.data,
            imu_frame=arguments.imu_frame,
            twist_index=arguments.twist_index,
            progress=lambda share: update(share, ""),
        )
    print_notes(drive)
    return drive


def print_notes(drive: Drive) -> None:
    """Print what the reader repaired or left out."""
    for note in drive.notes:
        print(f"note: {note}", file=sys.stderr)
