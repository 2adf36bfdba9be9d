# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam convert``: a dataset to a bag."""

import argparse

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer, tell_next
from vislam_ros.cli.reading import conventions, print_notes, use_format
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.conversion import convert


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    use_format(arguments)
    with progress_bar("converting", 1.0) as update:
        drive = convert(
            arguments.data,
            arguments.output,
            conventions=conventions(arguments),
            reference=arguments.reference,
            motion=arguments.motion,
            force=arguments.force,
            progress=lambda share: update(share, ""),
        )
    print_notes(drive)
    answer(
        f"{arguments.output}: {drive.steps} feature frames, {len(drive.ids)} observations of "
        f"{drive.tracks} tracks, {len(drive.twist_stamps)} twists, {drive.duration:.1f} s"
    )
    tell_next("run", str(arguments.output), "--out", f"results/{arguments.data.stem}")
    return OK
