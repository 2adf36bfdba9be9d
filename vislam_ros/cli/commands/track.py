# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam track``: images to tracks."""

import argparse

import numpy as np

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer
from vislam_ros.cli.played_bag import renamed_topics
from vislam_ros.cli.reading import conventions, print_notes, use_format
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.datasets.tracks_file import check_tracks_output, write_tracks
from vislam_ros.data.files.whole_file import refuse_existing
from vislam_ros.data.loading import load_images


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    check_tracks_output(arguments.output, force=arguments.force)
    if arguments.picture is not None:
        refuse_existing(arguments.picture, force=arguments.force)
    use_format(arguments)
    if is_bag(arguments.data):
        require_intact(arguments.data)
    with progress_bar("tracking", 1.0) as update:
        drive = load_images(
            arguments.data,
            arguments.motion,
            conventions=conventions(arguments),
            topics=renamed_topics(arguments),
            namespace=arguments.namespace,
            progress=lambda share: update(share, ""),
            picture=arguments.picture,
        )
    print_notes(drive)
    write_tracks(arguments.output, drive, force=arguments.force)
    counts = np.diff(drive.offsets)
    answer(
        f"{arguments.output}: {drive.steps} feature frames, {len(drive.ids)} observations of "
        f"{drive.tracks} tracks, {np.median(counts):.0f} a frame, "
        f"{len(drive.twist_stamps)} samples of motion, {drive.duration:.1f} s"
    )
    return OK
