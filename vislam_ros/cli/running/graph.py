# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The nodes and the player as processes, watched from their start to their end."""

import os
import shutil
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from vislam_ros.cli.domain import local_graph, own_domain
from vislam_ros.cli.ending import PassResults
from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import tell
from vislam_ros.cli.live_view import RunView, live_view
from vislam_ros.cli.parameters import RunParameters
from vislam_ros.cli.played_bag import PlayedBag
from vislam_ros.cli.processes import Child, Children
from vislam_ros.cli.running.drawing import Pictures
from vislam_ros.cli.running.interruptible import ignore_interrupts
from vislam_ros.cli.running.modules import NODES, PLAYER
from vislam_ros.cli.running.watch import Watch
from vislam_ros.data.bags.calibration import RECTIFIED_RULES
from vislam_ros.data.bags.layout import LEFT_COMPRESSED
from vislam_ros.data.files.parameter_file import write_parameters
from vislam_ros.data.results.completeness import TRACKER
from vislam_ros.data.results.recording import PLAYER_INTERRUPTED, STOPPED, map_patience
from vislam_ros.data.results.summary import has_ended, read_summary
from vislam_ros.data.results.writer import pass_directories
from vislam_ros.errors import VislamError

if TYPE_CHECKING:
    from vislam_ros.data.viewing.live import LiveViewer

_OF_RECTIFIED = tuple(word for rule in RECTIFIED_RULES for word in ("-r", ":=".join(rule)))

_POLL_SECONDS = 0.02
_LOOKS_A_SUMMARY = 5
_START_UP_SECONDS = 60.0
# The recorder waits for the map and then says how the run ended: so much longer than it.
_SETTLING_SECONDS = 30.0
_PARTING_SECONDS = 30.0


def run_graph(
    bag: PlayedBag,
    results: Path,
    parameters: RunParameters,
    rate: float,
    scratch: Path,
    viewer: "LiveViewer | None",
    prepared: Mapping[str, Child],
    watch: Watch,
    pictures: Pictures,
) -> None:
    """Start the graph, wait until the recorder is done, and end it whatever happens.

    Parameters
    ----------
    bag : PlayedBag
    results : Path
        The result directory, with its folder of logs.
    parameters : RunParameters
    rate : float
        Of the player.
    scratch : Path
        Folder for what only this run needs.
    viewer : LiveViewer or None
        Shows it too.
    prepared : mapping of str to Child
        Nodes and player that are ready to begin.
    watch : Watch
        Over them, and over those that are started here.
    pictures : Pictures
        Get ready when all is played, and are begun when all is recorded.

    Raises
    ------
    VislamError
        Where a process ends before its time, stands still, or the recorder does not come to its
        end.
    """
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
        children = Children(environment, results / "log", prepared)
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
                    PLAYER,
                    "vislam_ros.cli.main",
                    [
                        *([] if PLAYER in prepared else ["play"]),
                        str(bag.path),
                        "--whole-graph",
                        *bag.player_arguments,
                        *(["--clock"] if simulates_time else []),
                        f"--wait={_START_UP_SECONDS}",
                        f"--rate={rate}",
                    ],
                )
                for child in (*nodes, player):
                    watch.add(child)
                with live_view(bag.frames) as update:
                    wait_until_recorded(watch, player, results, RunView(update, viewer), pictures)
        finally:
            ignore_interrupts()
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
    # The wheels of ROS have no such command.
    tell(f"to join this run: {settings}{' ros2 topic list' if shutil.which('ros2') else ''}")


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


def wait_until_recorded(
    watch: Watch, player: Child, results: Path, view: RunView, pictures: Pictures
) -> None:
    """Wait until the recorder says how the run ended, with its last pass.

    Times are counted in looks at the processes, so that a run which was stopped as a whole goes on
    as if nothing had been.

    Raises
    ------
    VislamError
        Where a process ends before its time, stands still, or the recorder does not come to its
        end.
    """
    looks = looks_since_the_player = looks_since_the_end = 0
    while True:
        watch.check()
        if looks % _LOOKS_A_SUMMARY == 0 and (summaries := summaries_of(results)):
            steps, newest = sum(summary["steps"] for _, summary in summaries), summaries[-1][1]
            view.show(summaries)
            if str(newest["incomplete_reason"]).startswith(STOPPED):
                raise VislamError("recorder_node was told to end")
            if has_ended(newest):
                if newest["incomplete_reason"] == PLAYER_INTERRUPTED:
                    return  # nothing more will come, whether or not the player leaves
                if not looks_since_the_end and all(each["complete"] for _, each in summaries):
                    pictures.begin([directory for directory, _ in summaries])
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
        if looks_since_the_player == 1:
            # slam_node goes back over the drive, and leaves the other cores.
            pictures.prepare([directory for directory, _ in summaries_of(results)])
        time.sleep(_POLL_SECONDS)


def summaries_of(results: Path) -> list[PassResults]:
    """Summaries as they stand, of each pass that there is so far."""
    summaries: list[PassResults] = []
    for directory in pass_directories(results):
        with suppress(VislamError):
            summaries.append((directory, read_summary(directory / "summary.json")))
    return summaries
