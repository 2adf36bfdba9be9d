# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A run from what it is given to its results."""

import argparse
import tempfile
import time
from collections.abc import Mapping
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import Any

from vislam_ros.cli.ending import PassResults, print_passes, require_complete, tell_written
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.live_view import opened_viewer
from vislam_ros.cli.parameters import RunParameters, report_unused, run_parameters
from vislam_ros.cli.played_bag import PlayedBag, renamed_topics
from vislam_ros.cli.processes import Child
from vislam_ros.cli.reading import conventions, print_notes, use_format
from vislam_ros.cli.running.drawing import Pictures
from vislam_ros.cli.running.graph import run_graph, summaries_of
from vislam_ros.cli.running.interruptible import interruptible
from vislam_ros.cli.running.watch import Watch
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.reader import check_readable
from vislam_ros.data.conversion import convert
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.bags.reader import matches as has_bag_images
from vislam_ros.data.results.summary import has_ended
from vislam_ros.data.results.writer import pass_directories, refuse_used
from vislam_ros.errors import OutputError, VislamError

_INTERRUPTED = "the run was interrupted"


def run_session(
    arguments: argparse.Namespace, started: float, prepared: Mapping[str, Child], watch: Watch
) -> int:
    """Run a drive through the graph, and return the exit code.

    Parameters
    ----------
    arguments : argparse.Namespace
        Of ``vislam run``.
    started : float
        When the command began, by the monotonic clock.
    prepared : mapping of str to Child
        Nodes and player that are ready to begin.
    watch : Watch
        Over them, and over those that follow.

    Raises
    ------
    VislamError
        Where there can be no run, or it did not end whole.
    """
    parameters = run_parameters(arguments)
    report_unused(parameters)
    results: Path = arguments.out
    refuse_used(results, force=arguments.force)
    error: BaseException | None = None
    with tempfile.TemporaryDirectory(prefix="vislam_run_") as folder:
        scratch = Path(folder)
        wanted = not arguments.no_pictures
        with closing(Pictures(scratch, arguments.data.stem, wanted=wanted)) as pictures:
            with (
                interruptible(),
                opened_viewer(arguments.data.stem, wanted=arguments.view) as viewer,
            ):
                bag = _bag(arguments, parameters, scratch, watch)
                watch.check()
                _claim(results)
                try:
                    run_graph(
                        bag,
                        results.resolve(),  # the nodes need not run in this folder
                        parameters,
                        arguments.rate,
                        scratch,
                        viewer,
                        prepared,
                        watch,
                        pictures,
                    )
                except (KeyboardInterrupt, VislamError) as caught:
                    error = caught
                passes = _end_summaries(results, started, arguments.data.stem, error)
            print_passes(passes)
            if isinstance(error, KeyboardInterrupt):
                tell(f"interrupted: what there is stands in {results}")
                return INTERRUPTED
            if error is not None:
                raise error
            require_complete(passes)
            pictures.finish()
    tell_written(passes, arguments.data)
    return OK


def _claim(directory: Path) -> None:
    """Make the result directory with its folder of logs."""
    try:
        # They must not be taken for those that the recorder is going to write.
        for folder in pass_directories(directory):
            (folder / "summary.json").unlink(missing_ok=True)
        (directory / "log").mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise VislamError(
            f"{directory}: cannot be a result directory: {error.strerror}"
        ) from error


def _bag(
    arguments: argparse.Namespace, parameters: RunParameters, scratch: Path, watch: Watch
) -> PlayedBag:
    """Return the bag to play: the one given, if the nodes can use it, or one made of the data."""
    rules = parameters.reading
    renamed, namespace = renamed_topics(arguments), arguments.namespace
    images: dict[str, Any] = {
        "motion": arguments.motion,
        "tracks": arguments.tracks,
        "tracker": parameters.tracker,
    }
    if is_bag(arguments.data):
        require_intact(arguments.data)
    if is_bag(arguments.data) and has_bag_images(arguments.data, renamed):
        if arguments.motion is None and not arguments.tracks and not namespace:
            opened = read_images(arguments.data, rules=rules, topics=renamed)
            if opened.is_of_graph:
                # What solve refuses the graph would only wait for.
                opened.known_motion()
                return PlayedBag.of(Path(arguments.data).resolve(), namespace, {})
        images |= {"topics": renamed, "namespace": namespace}
        renamed = {}
    elif is_bag(arguments.data):
        check_readable(arguments.data, rules=rules, topics=renamed, namespace=namespace)
        return PlayedBag.of(Path(arguments.data).resolve(), namespace, renamed)
    use_format(arguments)
    bag = scratch / arguments.data.stem
    with progress_bar("converting", 1.0) as update:

        def progress(share: float) -> None:
            watch.check()
            update(share, "")

        drive = convert(
            arguments.data,
            bag,
            conventions=conventions(arguments),
            frames=rules.frames,
            progress=progress,
            **images,
        )
    print_notes(drive)
    return PlayedBag.of(bag, namespace, renamed)


def _end_summaries(
    results: Path, started: float, drive: str, error: BaseException | None
) -> list[PassResults]:
    """Put into the summaries what the recorder cannot know, and return them."""
    total_s = time.monotonic() - started
    ended: list[tuple[Path, dict[str, Any]]] = [
        (directory, {**summary, "drive": summary["drive"] or drive, "total_s": total_s})
        for directory, summary in summaries_of(results)
    ]
    if error is not None and ended and not ended[-1][1]["complete"]:
        directory, newest = ended[-1]
        if not has_ended(newest):  # a killed recorder: its rows are there, and its count is old
            newest["steps"] = _count_poses(directory)
        reason = _INTERRUPTED if isinstance(error, KeyboardInterrupt) else str(error)
        newest["incomplete_reason"] = reason
    for directory, summary in ended:
        # Of two errors the first is the one to tell.
        with suppress(OutputError) if error is not None else nullcontext():
            write_json(directory / "summary.json", summary)
    return [(directory, summary) for directory, summary in ended]


def _count_poses(directory: Path) -> int:
    try:
        return len((directory / "trajectory.tum").read_bytes().splitlines())
    except OSError:
        return 0
