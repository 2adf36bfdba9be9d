# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a run: a file, the command line's overrides, and what they amount to."""

import argparse
import dataclasses
import difflib
import os
import re
import sys
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vislam_ros.cli.lines import tell
from vislam_ros.core.filters.flat_settings import setting_owners, slam_settings, unused_note
from vislam_ros.core.filters.settings import GivenMapSettings
from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import (
    PredictionSettings,
    SlamSettings,
    nearest_name,
    settings_from_dict,
)
from vislam_ros.data.bags.layout import Frames
from vislam_ros.data.bags.reader import ReadingRules
from vislam_ros.data.files.parameter_file import names_for_all, node_parameters, read_parameters
from vislam_ros.data.results.completeness import TRACKER
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.errors import SettingsError, VislamError
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.nodes.settings import (
    PredictionNodeSettings,
    RecorderSettings,
    SlamNodeSettings,
    SlamOutputSettings,
    TrackerNodeSettings,
)

SETTINGS_OF_NODES: dict[str, tuple[Any, ...]] = {
    "imu_prediction_node": (PredictionNodeSettings, PredictionSettings),
    "slam_node": (SlamNodeSettings, SlamOutputSettings),
    "recorder_node": (RecorderSettings,),
    TRACKER: (TrackerNodeSettings, TrackerSettings),
}
"""The nodes' own; slam_node has those of its estimator, too."""

# Of the parameters that they are put over.
_FLAGS = {
    "estimator": "--estimator",
    "feature_fraction": "--fraction",
    "seed": "--seed",
    "map_file": "--map",
    "motion_source": "--motion-source",
}
_OF_EVERY_NODE = re.compile(r"use_sim_time|qos_overrides\..+")


@dataclass(frozen=True)
class RunParameters:
    """What the nodes are given, checked.

    Attributes
    ----------
    given : dict of str to dict
        Node name to the parameters that the file and the command line set.
    slam, prediction : SlamSettings, PredictionSettings
    given_map : LandmarkMap or None
        The map of an estimator that needs one.
    reading : ReadingRules
        How the nodes would take a bag's messages.
    tracker : TrackerSettings
        Of the tracks of images.
    notes : tuple of str
        What the file may not mean.
    """

    given: dict[str, dict[str, Any]]
    slam: SlamSettings
    prediction: PredictionSettings
    given_map: LandmarkMap | None
    reading: ReadingRules
    tracker: TrackerSettings
    notes: tuple[str, ...] = ()

    @property
    def slam_values(self) -> dict[str, Any]:
        """Settings of estimators among what slam_node is given, of the chosen one or another."""
        values = self.given["slam_node"]
        return _among(values, setting_owners(values))


def shared_file(name: str) -> Path | None:
    """Find ``config/NAME`` of the source tree, the ROS workspace or the Python environment."""
    shares = [
        Path(prefix) / "share" / "vislam_ros"
        for prefix in (*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix)
        if prefix
    ]
    for folder in (Path(__file__).resolve().parents[2], *shares):
        file = folder / "config" / name
        if file.is_file():
            return file
    return None


def run_parameters(arguments: argparse.Namespace) -> RunParameters:
    """Read ``--params`` or the default file, and put the other flags over it.

    Raises
    ------
    VislamError
        Naming the file, node, parameter and value that will not do.
    """
    file = arguments.params or shared_file("ekf.yaml")
    content = read_parameters(file) if file else {}
    overrides: dict[str, Any] = {
        "estimator": arguments.estimator,
        "feature_fraction": arguments.fraction,
        "seed": arguments.seed,
        "map_file": arguments.map and str(arguments.map.resolve()),
    }
    overrides_of = {
        "slam_node": overrides,
        "imu_prediction_node": {"motion_source": arguments.motion_source},
    }
    given: dict[str, dict[str, Any]] = {}
    checked: dict[Any, Any] = {}
    for node in SETTINGS_OF_NODES:
        try:
            own = node_parameters(content, node, getattr(arguments, "namespace", ""))
        except VislamError as error:
            raise VislamError(f"{file}: {error}") from error
        flags = overrides_of.get(node, {})
        own.update({name: value for name, value in flags.items() if value is not None})
        if node == TRACKER:
            # A file that does not speak of it means slam_node's frames for it, too.
            own = {**_among(given["slam_node"], ("base_frame", "camera_frame")), **own}
        try:
            known = _known(node, own)
            others = names_for_all(content, node) - known - _of_every_node(own)
            given[node] = {name: value for name, value in own.items() if name not in others}
            checked.update(_checked(node, known, given[node]))
        except SettingsError as error:
            name, _, reason = str(error).partition(": ")
            if flags.get(name) is not None:
                raise SettingsError(f"{_FLAGS[name]}: {reason}") from error
            raise SettingsError(f"{f'{file}: ' if file else ''}{node}: {error}") from error
    slam = checked[SlamSettings]
    if isinstance(slam, GivenMapSettings) and not slam.map_file:
        raise SettingsError(
            f"estimator: {slam.estimator} needs a map: add --map with the landmarks.npz of a run"
        )
    map_file = given["slam_node"].get("map_file")
    return RunParameters(
        given=given,
        slam=slam,
        prediction=checked[PredictionSettings],
        given_map=read_landmarks(Path(map_file)) if map_file else None,
        reading=_reading_rules(f"{file}: " if file else "", checked),
        tracker=checked[TrackerSettings],
        notes=tuple(f"{file}: {note}" for note in _misspelt_nodes(content)),
    )


def _misspelt_nodes(names: Iterable[str]) -> Iterator[str]:
    """Notes on nodes of a file that are nearly ours; it may well be for others, too."""
    nodes = {name.rpartition("/")[2] for name in names}
    for node in sorted(nodes - SETTINGS_OF_NODES.keys()):
        for ours in difflib.get_close_matches(node, SETTINGS_OF_NODES.keys() - nodes, 1, 0.8):
            yield f"{node}: no node of ours, it changes nothing; did you mean {ours}?"


def _reading_rules(where: str, checked: dict[Any, Any]) -> ReadingRules:
    """Rules of the nodes' settings, which must agree on the frames between the nodes."""
    slam, prediction = checked[SlamNodeSettings], checked[PredictionNodeSettings]
    for node, settings, names in (
        ("imu_prediction_node", prediction, ("odom_frame", "base_frame")),
        (TRACKER, checked[TrackerNodeSettings], ("base_frame", "camera_frame")),
    ):
        for name in names:
            one, other = getattr(settings, name), getattr(slam, name)
            if one != other:
                raise SettingsError(
                    f"{where}{name}: is {one!r} for {node} and {other!r} for slam_node: give both "
                    "the same"
                )
    return ReadingRules(
        frames=Frames(slam.map_frame, slam.odom_frame, slam.base_frame, slam.camera_frame),
        twist_time_jump=checked[PredictionSettings].time_jump,
        features_time_jump=checked[SlamSettings].time_jump,
        imu_turns=prediction.angular_velocity_source == "imu",
        motion_source=checked[PredictionSettings].motion_source,
    )


def report_unused(parameters: RunParameters) -> None:
    """Print a line where parameters were set that the estimator, or none of the nodes, uses."""
    for each in parameters.notes:
        tell(f"note: {each}")
    note = unused_note(parameters.given["slam_node"])
    if note:
        tell(f"warning: slam_node: {note}")


def _known(node: str, values: Mapping[str, Any]) -> set[str]:
    """Names of the parameters that a node with these values may be given."""
    known = {name for cls in SETTINGS_OF_NODES[node] for name in _names(cls)}
    return known | setting_owners(values).keys() if node == "slam_node" else known


def _of_every_node(values: Mapping[str, Any]) -> set[str]:
    """Names among those of parameters that ROS itself gives every node."""
    return {name for name in values if _OF_EVERY_NODE.fullmatch(name)}


def _checked(node: str, known: set[str], values: Mapping[str, Any]) -> dict[Any, Any]:
    """Settings by class, of one node's parameters; slam_node's estimator's as SlamSettings."""
    for name in sorted(values.keys() - known - _of_every_node(values)):
        raise SettingsError(f"{name}: no such parameter{nearest_name(name, known)}")
    classes = SETTINGS_OF_NODES[node]
    settings = {cls: settings_from_dict(cls, _among(values, _names(cls))) for cls in classes}
    if node == "slam_node":
        settings[SlamSettings] = slam_settings(_among(values, setting_owners(values)))
    return settings


def _names(cls: Any) -> set[str]:
    return {field.name for field in dataclasses.fields(cls)}


def _among(values: Mapping[str, Any], names: Container[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}
