# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam convert``: a dataset or images to a bag."""

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
            tracks=arguments.tracks,
            force=arguments.force,
            progress=lambda share: update(share, ""),
        )
    print_notes(drive)
    if len(drive.ids) or not drive.steps:
        held = f"feature frames, {len(drive.ids)} observations of {drive.tracks} tracks"
    else:
        held = "pairs of images"
    answer(
        f"{arguments.output}: {drive.steps} {held}, {len(drive.twist_stamps)} samples of motion, "
        f"{drive.duration:.1f} s"
    )
    tell_next("run", str(arguments.output), "--out", f"results/{arguments.data.stem}")
    return OK
