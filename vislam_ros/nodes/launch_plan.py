# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``ros2 launch vislam_ros vislam.launch.py`` starts, told without the launch system.

``launch/vislam.launch.py`` hands this over; here it can be tested where launch is not installed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vislam_ros.data.bags import layout
from vislam_ros.data.bags.calibration import RECTIFIED_RULES
from vislam_ros.data.files.parameter_file import Parameters, node_parameters, read_parameters
from vislam_ros.errors import SettingsError, VislamError

#: Topics that ``config/vislam.rviz`` shows.
SHOWN = (
    layout.ODOMETRY,
    layout.PREDICTION,
    layout.GROUND_TRUTH,
    layout.LANDMARKS,
    layout.PATH,
    layout.TRACK_IMAGE,
)

#: How long a recorder may take for its map after Ctrl-C, before it is told again [s].
RECORDER_SECONDS = 60


@dataclass(frozen=True)
class Argument:
    """An argument of the launch file.

    Attributes
    ----------
    default, description : str
    choices : tuple of str
        Empty where anything will do.
    """

    default: str
    description: str
    choices: tuple[str, ...] = ()


_SWITCH = ("true", "false")


def arguments(share: Path) -> dict[str, Argument]:
    """Arguments by name, with the files of the package's share folder as defaults."""
    return {
        "bag": Argument("", "Bag to play; without one the nodes wait for a robot's topics"),
        "rate": Argument("1.0", "Times real time at which to play; 0: as fast as the graph can"),
        "results": Argument("", "Result directory to record; without one nothing is recorded"),
        "force": Argument("false", "Replace an existing result directory", _SWITCH),
        "params_file": Argument(
            str(share / "config" / "ekf.yaml"), "Parameters of the nodes, in whatever namespace"
        ),
        "namespace": Argument("", "Namespace of the nodes and of what is played, such as robot1"),
        "use_tracker": Argument(
            "false", "Start stereo_tracker_node, which makes features of stereo images", _SWITCH
        ),
        "use_sim_time": Argument(
            "false", "Take the time of /clock, which the player then publishes", _SWITCH
        ),
        "rviz": Argument("false", "Start RViz with rviz_config", _SWITCH),
        "rviz_config": Argument(str(share / "config" / "vislam.rviz"), "What RViz shows"),
        "log_level": Argument("info", "Log level of the nodes"),
    }


@dataclass(frozen=True)
class Process:
    """A process to start: the arguments of a node action of launch.

    Attributes
    ----------
    executable : str
    package : str
    namespace : str
    parameters : dict
    arguments : tuple of str
        Before those of ROS.
    remappings : tuple of (str, str)
    ros_arguments : tuple of str
    patience : int
        Seconds from Ctrl-C until it is told again.
    """

    executable: str
    package: str = "vislam_ros"
    namespace: str = ""
    parameters: dict[str, Any] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()
    remappings: tuple[tuple[str, str], ...] = ()
    ros_arguments: tuple[str, ...] = ()
    patience: int = 5


def planned(values: Mapping[str, str]) -> list[Process]:
    """Processes that values of all arguments ask for, the player after those that it plays for.

    Raises
    ------
    VislamError
        Where the parameter file or a value will not do, naming it.
    """
    given = read_parameters(Path(values["params_file"]))
    return [*_nodes(values, given), *_player(values), *_rviz(values)]


def _own_parameters(values: Mapping[str, str], given: Parameters, node: str) -> dict[str, Any]:
    try:
        return node_parameters(given, node, values["namespace"])
    except VislamError as error:
        raise VislamError(f"{values['params_file']}: {error}") from error


def _nodes(values: Mapping[str, str], given: Parameters) -> Iterator[Process]:
    names = ["imu_prediction_node", "slam_node"]
    if _on(values, "use_tracker"):
        names.append("stereo_tracker_node")
    if values["results"]:
        names.append("recorder_node")
    for name in names:
        parameters = _own_parameters(values, given, name)
        parameters |= {"use_sim_time": _on(values, "use_sim_time")}
        if name == "recorder_node":
            parameters |= {"directory": values["results"], "force": _on(values, "force")}
        if name == "stereo_tracker_node" and values["bag"]:
            parameters["queue_size"] = 0  # no image of a bag is to be lost
        of_tracker = name == "slam_node" and _on(values, "use_tracker")
        yield Process(
            name,
            namespace=values["namespace"],
            parameters=parameters,
            remappings=RECTIFIED_RULES if of_tracker else (),
            ros_arguments=("--log-level", values["log_level"]),
            patience=RECORDER_SECONDS if values["results"] else 5,
        )


def _player(values: Mapping[str, str]) -> Iterator[Process]:
    if not values["bag"]:
        return
    told = ["play", values["bag"], "--rate", values["rate"]]
    if values["namespace"]:
        told += ["--namespace", f"/{values['namespace'].strip('/')}"]
    if values["results"]:
        told.append("--whole-graph")
    if _on(values, "use_sim_time"):
        told.append("--clock")
    yield Process("vislam", arguments=tuple(told))


def _rviz(values: Mapping[str, str]) -> Iterator[Process]:
    if not _on(values, "rviz"):
        return
    namespace = values["namespace"].strip("/")
    moved = {topic.recorded: f"/{namespace}{topic.recorded}" for topic in SHOWN}
    yield Process(
        "rviz2",
        package="rviz2",
        arguments=("-d", values["rviz_config"]),
        parameters={"use_sim_time": _on(values, "use_sim_time")},
        remappings=tuple(moved.items()) if namespace else (),
    )


def _on(values: Mapping[str, str], name: str) -> bool:
    if values[name] not in _SWITCH:
        raise SettingsError(f"{name}: {values[name]!r} is neither true nor false")
    return values[name] == "true"
