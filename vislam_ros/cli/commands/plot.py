# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam plot``: pictures of results."""

import argparse

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer
from vislam_ros.data.evaluation.association import read_reference
from vislam_ros.data.results.reader import read_results


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    results = read_results(arguments.directory)
    reference = read_reference(arguments.reference, results) if arguments.reference else None
    # It takes a second to import, which what cannot be read need not wait for.
    from vislam_ros.data.pictures.results import plot_results

    pictures = plot_results(
        results,
        reference,
        output=arguments.output,
        force=arguments.force,
        laying=arguments.align,
        picture_format=arguments.format,
    )
    for picture in pictures:
        answer(str(picture))
    return OK
