# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam view``: results in the Rerun viewer."""

import argparse

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer
from vislam_ros.cli.parameters import run_parameters
from vislam_ros.cli.played_bag import renamed_topics
from vislam_ros.cli.reading import conventions, read_input
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.association import read_reference
from vislam_ros.data.image_sources import is_images, read_images
from vislam_ros.data.images.bags.reader import matches as has_bag_images
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.data.viewing.results import log_results
from vislam_ros.data.viewing.stream import check_stream, opened_stream
from vislam_ros.errors import VislamError


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    check_stream(arguments.save, force=arguments.force)
    results = read_results(arguments.directory)
    reference = read_reference(arguments.reference, results) if arguments.reference else None
    drive, images = None, None
    if arguments.data is not None:
        drive = _drive(arguments, results)
        images = _images(arguments)
    with (
        opened_stream(results.name, arguments.save, force=arguments.force) as stream,
        progress_bar("logging images", 1.0 if images else 0.0) as update,
    ):
        log_results(
            stream,
            results,
            reference,
            drive=drive,
            images=images,
            progress=lambda share: update(share, ""),
        )
    if arguments.save is not None:
        answer(str(arguments.save))
    return OK


def _drive(arguments: argparse.Namespace, results: Results) -> Drive:
    """The pass of the data that the results are of."""
    first = int(results.trajectory.stamps[0])
    passes = read_input(arguments, run_parameters(arguments).reading)
    for drive in passes:
        if first in drive.feature_stamps:
            return drive
    raise VislamError(
        f"{arguments.data}: has no frame at {first * 1e-9:.3f} s, the first pose of "
        f"{arguments.directory}: is it what was solved?"
    )


def _images(arguments: argparse.Namespace) -> StereoImages | None:
    """The images themselves, where the data are such."""
    renamed = renamed_topics(arguments)
    if is_bag(arguments.data):
        if not has_bag_images(arguments.data, renamed):
            return None
    elif not is_images(arguments.data):
        return None
    return read_images(
        arguments.data,
        arguments.motion,
        conventions=conventions(arguments),
        rules=run_parameters(arguments).reading,
        topics=renamed,
        namespace=arguments.namespace,
    )
