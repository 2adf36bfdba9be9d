# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam run``: the live graph as processes, from a drive to a result directory.

This process never touches ROS: it starts the nodes and the player, watches them, and reads what
the recorder writes.
"""

import argparse
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from vislam_ros.cli.domain import local_graph, own_domain
from vislam_ros.cli.ending import PassResults, print_passes, require_complete, tell_written
from vislam_ros.cli.exit_codes import INTERRUPTED, OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.live_view import RunView, live_view, opened_viewer
from vislam_ros.cli.parameters import RunParameters, report_unused, run_parameters
from vislam_ros.cli.played_bag import PlayedBag, renamed_topics
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.reading import conventions, print_notes, use_format
from vislam_ros.cli.screen import progress_bar
from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.calibration import RECTIFIED_RULES
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.layout import LEFT_COMPRESSED
from vislam_ros.data.bags.reader import check_readable
from vislam_ros.data.conversion import convert
from vislam_ros.data.files.json_file import write_json
from vislam_ros.data.files.parameter_file import write_parameters
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.bags.reader import matches as has_bag_images
from vislam_ros.data.results.completeness import TRACKER
from vislam_ros.data.results.recording import STOPPED, map_patience
from vislam_ros.data.results.summary import has_ended, read_summary
from vislam_ros.data.results.writer import pass_directories, refuse_used
from vislam_ros.errors import OutputError, VislamError

if TYPE_CHECKING:
    from vislam_ros.data.viewing.live import LiveViewer

NODES = ("imu_prediction_node", "slam_node", "recorder_node")

_OF_RECTIFIED = tuple(word for rule in RECTIFIED_RULES for word in ("-r", ":=".join(rule)))

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
_INTERRUPTED = "the run was interrupted"
_POLL_SECONDS = 0.02
_LOOKS_A_SUMMARY = 5
# Long enough to stop a process and let it go on by hand; the whole run ends within 2 s.
_STOPPED_SECONDS = 1.0
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
    with (
        _interruptible(),
        tempfile.TemporaryDirectory(prefix="vislam_run_") as scratch,
        opened_viewer(arguments.data.stem, wanted=arguments.view) as viewer,
    ):
        bag = _bag(arguments, parameters, Path(scratch))
        _claim(results)
        try:
            _run_graph(bag, results, parameters, arguments.rate, Path(scratch), viewer)
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
    for directory, _ in passes:
        _draw(directory)
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


def _bag(arguments: argparse.Namespace, parameters: RunParameters, scratch: Path) -> PlayedBag:
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
                return PlayedBag.of(Path(arguments.data).resolve(), namespace, {})
        images |= {"topics": renamed, "namespace": namespace}
        renamed = {}
    elif is_bag(arguments.data):
        check_readable(arguments.data, rules=rules, topics=renamed, namespace=namespace)
        return PlayedBag.of(Path(arguments.data).resolve(), namespace, renamed)
    use_format(arguments)
    bag = scratch / arguments.data.stem
    with progress_bar("converting", 1.0) as update:
        drive = convert(
            arguments.data,
            bag,
            conventions=conventions(arguments),
            frames=rules.frames,
            progress=lambda share: update(share, ""),
            **images,
        )
    print_notes(drive)
    return PlayedBag.of(bag, namespace, renamed)


def _run_graph(
    bag: PlayedBag,
    results: Path,
    parameters: RunParameters,
    rate: float,
    scratch: Path,
    viewer: "LiveViewer | None",
) -> None:
    """Start the graph, wait until the recorder is done, and end it whatever happens."""
    recorder = {**parameters.given["recorder_node"], "directory": str(results), "force": True}
    tracker = {
        **parameters.given[TRACKER],
        # As offline: every pair has its samples, and none is lost.
        "gyroscope": "required",
        "queue_size": 0,
        "compressed": bag.images is LEFT_COMPRESSED,
    }
    params_file = scratch / "params.yaml"
    given = {**parameters.given, "recorder_node": recorder, TRACKER: tracker}
    if bag.has_gyroscope_alone and parameters.prediction.motion_source == "auto":
        # Told, the node need not wait for twists, which a short drive does not leave time for.
        given["imu_prediction_node"] = {**given["imu_prediction_node"], "motion_source": "gyro"}
    write_parameters(
        params_file,
        {f"{bag.namespace}/{node}": values for node, values in given.items() if values},
    )
    simulates_time = any(values.get("use_sim_time") for values in given.values())
    with _ros_environment(results / "log") as environment:
        _say_how_to_join(environment)
        children = Children(environment, results / "log")
        recorder_node: Child | None = None
        try:
            with _suspending(children):
                nodes = [
                    children.start(
                        name,
                        f"vislam_ros.nodes.{name}",
                        [
                            *("--ros-args", "--params-file", str(params_file)),
                            *bag.node_arguments,
                            *(_OF_RECTIFIED if bag.images and name == "slam_node" else ()),
                        ],
                    )
                    for name in ((TRACKER, *NODES) if bag.images else NODES)
                ]
                recorder_node = nodes[-1]
                player = children.start(
                    "player",
                    "vislam_ros.cli.main",
                    [
                        "play",
                        str(bag.path),
                        "--whole-graph",
                        *bag.player_arguments,
                        *(["--clock"] if simulates_time else []),
                        f"--wait={_START_UP_SECONDS}",
                        f"--rate={rate}",
                    ],
                )
                with live_view(bag.frames) as update:
                    _watch(nodes, player, results, RunView(update, viewer))
        finally:
            _ignore_interrupts()
            children.end(writer=recorder_node)


@contextmanager
def _ros_environment(log_folder: Path) -> Iterator[dict[str, str]]:
    """Environment of the children: on a domain and a machine of their own unless told."""
    environment = {**local_graph(), "ROS_LOG_DIR": str(log_folder / "ros"), **os.environ}
    given = environment.get("ROS_DOMAIN_ID")
    with nullcontext(given) if given else own_domain() as domain:
        yield {**environment, "ROS_DOMAIN_ID": str(domain)}


def _say_how_to_join(environment: Mapping[str, str]) -> None:
    names = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")
    settings = " ".join(f"{name}={environment[name]}" for name in names)
    tell(f"to join this run: {settings} ros2 topic list")


@contextmanager
def _suspending(children: Children) -> Iterator[None]:
    """Let Ctrl-Z stop the children too, which are in no terminal, and ``fg`` let them go on."""

    def suspend(_signal: int, _frame: FrameType | None) -> None:
        children.send(signal.SIGSTOP)
        signal.signal(signal.SIGTSTP, before)
        signal.raise_signal(signal.SIGTSTP)  # returns when this process goes on
        signal.signal(signal.SIGTSTP, suspend)
        children.send(signal.SIGCONT)

    before = signal.signal(signal.SIGTSTP, suspend)
    try:
        yield
    finally:
        signal.signal(signal.SIGTSTP, before)


def _watch(nodes: list[Child], player: Child, results: Path, view: RunView) -> None:
    """Wait until the recorder says how the run ended, with its last pass.

    Times are counted in looks at the processes, so that a run which was stopped as a whole goes on
    as if nothing had been.

    Raises
    ------
    VislamError
        Where a process ends before its time, stands still, or the recorder does not come to its
        end.
    """
    stopped: Counter[str] = Counter()
    looks = looks_since_the_player = looks_since_the_end = 0
    while True:
        for child in nodes:
            if child.exit_code is not None:
                raise child.died()
        if player.exit_code not in (None, OK):
            raise player.died()
        for child in (*nodes, player):
            stopped[child.name] = stopped[child.name] + 1 if child.is_stopped else 0
            if stopped[child.name] > _STOPPED_SECONDS / _POLL_SECONDS:
                raise VislamError(
                    f"{child.name} was stopped by a signal and did not go on ({child.log})"
                )
        if looks % _LOOKS_A_SUMMARY == 0 and (summaries := _summaries(results)):
            steps, newest = sum(summary["steps"] for _, summary in summaries), summaries[-1][1]
            view.show(summaries)
            if str(newest["incomplete_reason"]).startswith(STOPPED):
                raise VislamError("recorder_node was told to end")
            if has_ended(newest):
                looks_since_the_end += _LOOKS_A_SUMMARY
                if (
                    player.exit_code == OK
                    or looks_since_the_end > _PARTING_SECONDS / _POLL_SECONDS
                ):
                    return
            patience = map_patience(steps) + _SETTLING_SECONDS
            if looks_since_the_player > patience / _POLL_SECONDS:
                raise VislamError(f"recorder_node did not come to its end in {patience:.0f} s")
        looks += 1
        looks_since_the_player += player.exit_code == OK
        time.sleep(_POLL_SECONDS)


def _summaries(results: Path) -> list[PassResults]:
    """Summaries as they stand, of each pass that there is so far."""
    summaries: list[PassResults] = []
    for directory in pass_directories(results):
        with suppress(VislamError):
            summaries.append((directory, read_summary(directory / "summary.json")))
    return summaries


def _end_summaries(
    results: Path, started: float, drive: str, error: BaseException | None
) -> list[PassResults]:
    """Put into the summaries what the recorder cannot know, and return them."""
    total_s = time.monotonic() - started
    ended: list[tuple[Path, dict[str, Any]]] = [
        (directory, {**summary, "drive": summary["drive"] or drive, "total_s": total_s})
        for directory, summary in _summaries(results)
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


def _draw(directory: Path) -> None:
    # Not needed before the end, and slow to import.
    from vislam_ros.data.pictures.results import plot_results
    from vislam_ros.data.results.reader import read_results

    try:
        plot_results(read_results(directory), force=True, of_run=True)
    except VislamError as error:
        tell(f"warning: no picture: {error}")
