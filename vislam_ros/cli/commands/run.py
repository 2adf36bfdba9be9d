# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam run``: the live graph as processes, from a drive to a result directory.

This process never touches ROS: it starts the nodes and the player, watches them, and reads what
the recorder writes.
"""

import argparse
import json
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

from vislam_ros.cli.domain import own_domain
from vislam_ros.cli.ending import PassResults, print_passes, require_complete
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.parameters import RunParameters, report_unused, run_parameters, shared_file
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.reading import conventions, print_notes, use_format
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import BagMessages, is_bag
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.layout import FEATURES
from vislam_ros.data.bags.reader import ReadingRules, check_readable
from vislam_ros.data.conversion import convert
from vislam_ros.data.files.parameter_file import write_parameters
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.data.results.recording import map_patience
from vislam_ros.data.results.summary import RunSummary, read_summary
from vislam_ros.data.results.writer import pass_directories, refuse_used
from vislam_ros.errors import VislamError

NODES = ("imu_prediction_node", "slam_node", "recorder_node")

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
_POLL_SECONDS = 0.1
_START_UP_SECONDS = 60.0
# The recorder waits for the map and then says how the run ended: so much longer than it.
_SETTLING_SECONDS = 30.0
_PARTING_SECONDS = 30.0


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    started = time.monotonic()
    parameters = run_parameters(arguments)
    report_unused(parameters)
    results: Path = arguments.out.resolve()
    refuse_used(results, force=arguments.force)
    error: BaseException | None = None
    with _interruptible(), tempfile.TemporaryDirectory(prefix="vislam_run_") as scratch:
        bag = _bag(arguments, parameters.reading, Path(scratch))
        _claim(results)
        try:
            _run_graph(bag, results, parameters, arguments.rate, Path(scratch))
        except (KeyboardInterrupt, VislamError) as caught:
            error = caught
        passes = _end_summaries(results, started, arguments.data.stem)
    print_passes(passes)
    if isinstance(error, KeyboardInterrupt):
        tell(f"interrupted: what there is stands in {results}")
        return INTERRUPTED
    if error is not None:
        raise error
    require_complete(passes)
    for directory, _ in passes:
        _draw(directory)
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


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let SIGTERM interrupt as Ctrl-C does; the ending itself is not to be interrupted."""

    def interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
        _ignore_interrupts()
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in _INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _ignore_interrupts() -> None:
    for number in _INTERRUPTS:
        signal.signal(number, signal.SIG_IGN)


def _bag(arguments: argparse.Namespace, rules: ReadingRules, scratch: Path) -> Path:
    """Return the bag to play: the one given, if the nodes can use it, or one of the dataset."""
    if is_bag(arguments.data):
        require_intact(arguments.data)
        check_readable(arguments.data, rules=rules)
        return Path(arguments.data).resolve()
    use_format(arguments)
    bag = scratch / arguments.data.stem
    with progress_bar("converting", 1.0) as update:
        drive = convert(
            arguments.data,
            bag,
            conventions=conventions(arguments),
            frames=rules.frames,
            progress=lambda share: update(share, ""),
        )
    print_notes(drive)
    return bag


def _run_graph(
    bag: Path, results: Path, parameters: RunParameters, rate: float, scratch: Path
) -> None:
    """Start the graph, wait until the recorder is done, and end it whatever happens."""
    recorder = {**parameters.given["recorder_node"], "directory": str(results), "force": True}
    params_file = scratch / "params.yaml"
    given = {**parameters.given, "recorder_node": recorder}
    write_parameters(params_file, {node: values for node, values in given.items() if values})
    frames = _count_frames(bag)
    with _ros_environment(results / "log") as environment:
        children = Children(environment, results / "log")
        try:
            nodes = [
                children.start(
                    name,
                    f"vislam_ros.nodes.{name}",
                    ["--ros-args", "--params-file", str(params_file)],
                )
                for name in NODES
            ]
            player = children.start(
                "player",
                "vislam_ros.cli.main",
                [
                    "play",
                    str(bag),
                    "--whole-graph",
                    f"--wait={_START_UP_SECONDS}",
                    f"--rate={rate}",
                ],
            )
            with progress_bar("running", frames) as update:
                _watch(nodes, player, results, update)
        except (KeyboardInterrupt, VislamError):
            _ignore_interrupts()
            _part(children, results)
            raise
        finally:
            children.end()


def _count_frames(bag: Path) -> int:
    with BagMessages(bag) as messages:
        counts = {connection.topic: connection.count for connection in messages.connections}
    return counts.get(FEATURES.recorded, 0)


@contextmanager
def _ros_environment(log_folder: Path) -> Iterator[dict[str, str]]:
    """Environment of the children: on a domain and a machine of their own unless told."""
    profiles = shared_file("fastdds.xml")
    environment = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(log_folder / "ros"),
        **({"FASTRTPS_DEFAULT_PROFILES_FILE": str(profiles)} if profiles else {}),
        **os.environ,
    }
    given = environment.get("ROS_DOMAIN_ID")
    with nullcontext(given) if given else own_domain() as domain:
        yield {**environment, "ROS_DOMAIN_ID": str(domain)}


def _watch(
    nodes: list[Child], player: Child, results: Path, update: Callable[[float, str], None]
) -> None:
    """Wait until the recorder says how the run ended, with its last pass.

    Raises
    ------
    VislamError
        Where a process ends before its time or the recorder does not come to its end.
    """
    player_ended: float | None = None
    while True:
        summaries = _summaries(results)
        steps = sum(summary["steps"] for _, summary in summaries)
        if summaries:
            update(steps, f"{summaries[-1][1]['landmarks'] or 0} landmarks")
        if _is_settled(summaries):
            player.wait(_PARTING_SECONDS)
            return
        for child in nodes:
            if child.exit_code is not None:
                raise child.died()
        if player.exit_code not in (None, OK):
            raise player.died()
        if player.exit_code == OK:
            player_ended = player_ended or time.monotonic()
            patience = map_patience(steps) + _SETTLING_SECONDS
            if time.monotonic() - player_ended > patience:
                raise VislamError(f"recorder_node did not come to its end in {patience:.0f} s")
        time.sleep(_POLL_SECONDS)


def _part(children: Children, results: Path) -> None:
    """Let the player say good-bye and the recorder hear it, if they are at work at all."""
    summaries = _summaries(results)
    if not (summaries and summaries[0][1]["steps"] and children.all_alive()):
        return
    children.last.ask_to_end()
    end = time.monotonic() + _PARTING_SECONDS
    while time.monotonic() < end and not _is_settled(_summaries(results)):
        time.sleep(_POLL_SECONDS)


def _summaries(results: Path) -> list[PassResults]:
    """Summaries as they stand, of each pass that there is so far."""
    summaries: list[PassResults] = []
    for directory in pass_directories(results):
        with suppress(VislamError):
            summaries.append((directory, read_summary(directory / "summary.json")))
    return summaries


def _is_settled(summaries: list[PassResults]) -> bool:
    """Whether the newest pass has ended; one that begins is there before the last one ends."""
    if not summaries:
        return False
    _, newest = summaries[-1]
    return bool(newest["complete"] or newest["incomplete_reason"] != RunSummary.incomplete_reason)


def _end_summaries(results: Path, started: float, drive: str) -> list[PassResults]:
    """Put into the summaries what the recorder cannot know, and return them."""
    total_s = time.monotonic() - started
    ended: list[PassResults] = [
        (directory, {**summary, "drive": summary["drive"] or drive, "total_s": total_s})
        for directory, summary in _summaries(results)
    ]
    for directory, summary in ended:
        content = json.dumps(summary, indent=2) + "\n"
        replace_file(directory / "summary.json", content.encode("utf-8"))
    return ended


def _draw(directory: Path) -> None:
    # Not needed before the end, and slow to import.
    from vislam_ros.data.pictures.results import plot_results
    from vislam_ros.data.results.reader import read_results

    try:
        plot_results(read_results(directory), force=True)
    except VislamError as error:
        tell(f"warning: no picture: {error}")
