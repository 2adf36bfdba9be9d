# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam verify``: whether a bag or a result directory is whole."""

import argparse
from pathlib import Path

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.cli.lines import answer, tell, tell_next
from vislam_ros.cli.parameters import run_parameters
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import verify_bag
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.bags.reader import matches as has_images
from vislam_ros.data.results.faults import result_faults
from vislam_ros.data.results.writer import note_on_passes
from vislam_ros.errors import VislamError


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    path: Path = arguments.path
    is_result = path.is_dir() and not is_bag(path) and (path / "summary.json").exists()
    if is_result:
        faults, notes = result_faults(path), []
        if note := note_on_passes(path):
            tell(f"note: {note}")
    else:
        report = verify_bag(path)
        faults, notes = list(report.faults) or _reading_faults(arguments), list(report.notes)
    for note in notes:
        tell(f"note: {path}: {note}")
    for fault in faults:
        tell(f"error: {path}: {fault}")
    if faults:
        return FAILED
    answer(f"{path}: whole")
    if is_result:
        tell_next("evaluate", str(path), "--reference", "REF.tum")
    else:
        tell_next("solve", str(path), "--out", f"results/{path.stem}")
    return OK


def _reading_faults(arguments: argparse.Namespace) -> list[str]:
    """Why ``solve`` cannot read a bag that is not damaged, a line or none."""
    path: Path = arguments.path
    try:
        rules = run_parameters(arguments).reading
        if has_images(path):
            read_images(path, rules=rules).known_motion()
        else:
            read_passes(path, rules=rules)
    except VislamError as error:
        return [
            f"is not damaged, but solve cannot read it: {str(error).removeprefix(f'{path}: ')}"
        ]
    return []
