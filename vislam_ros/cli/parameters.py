# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a run: a file, the command line's overrides, and what they amount to."""

import argparse
import dataclasses
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.settings import (
    PredictionSettings,
    SlamSettings,
    nearest_name,
    settings_from_dict,
)
from vislam_ros.data.bags.layout import Frames
from vislam_ros.data.bags.reader import ReadingRules
from vislam_ros.data.files.parameter_file import node_parameters, read_parameters
from vislam_ros.data.results.landmark_map import read_landmarks
from vislam_ros.errors import SettingsError
from vislam_ros.nodes.settings import (
    PredictionNodeSettings,
    RecorderSettings,
    SlamNodeSettings,
    SlamOutputSettings,
)

SETTINGS_OF_NODES: dict[str, tuple[Any, ...]] = {
    "imu_prediction_node": (PredictionNodeSettings, PredictionSettings),
    "slam_node": (SlamNodeSettings, SlamOutputSettings, SlamSettings),
    "recorder_node": (RecorderSettings,),
}


@dataclass(frozen=True)
class RunParameters:
    """What the nodes are given, checked.

    Attributes
    ----------
    given : dict of str to dict
        Node name to the parameters that the file and the command line set.
    slam, prediction : SlamSettings, PredictionSettings
    given_map : LandmarkMap or None
        The map of the estimator ``localization``.
    reading : ReadingRules
        How the nodes would take a bag's messages.
    """

    given: dict[str, dict[str, Any]]
    slam: SlamSettings
    prediction: PredictionSettings
    given_map: LandmarkMap | None
    reading: ReadingRules


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
    everyones = content.pop("**", {})  # may well hold parameters of nodes that are not ours
    overrides: dict[str, Any] = {
        "estimator": arguments.estimator,
        "feature_fraction": arguments.fraction,
        "seed": arguments.seed,
        "map_file": arguments.map and str(arguments.map.resolve()),
    }
    given, checked = {}, {}
    for node, classes in SETTINGS_OF_NODES.items():
        known = {field.name for cls in classes for field in dataclasses.fields(cls)}
        values = {name: value for name, value in everyones.items() if name in known}
        values.update(node_parameters(content, node))
        if node == "slam_node":
            values.update({k: v for k, v in overrides.items() if v is not None})
        given[node] = values
        checked[node] = _checked(f"{file}: " if file else "", node, classes, values)
    slam = checked["slam_node"]
    map_file = slam[SlamNodeSettings].map_file
    if slam[SlamSettings].estimator == "localization" and not map_file:
        raise SettingsError(
            "estimator: localization needs a map: add --map with the landmarks.npz of a run"
        )
    return RunParameters(
        given=given,
        slam=slam[SlamSettings],
        prediction=checked["imu_prediction_node"][PredictionSettings],
        given_map=read_landmarks(Path(map_file)) if map_file else None,
        reading=_reading_rules(f"{file}: " if file else "", checked),
    )


def _reading_rules(where: str, checked: dict[str, dict[Any, Any]]) -> ReadingRules:
    """Rules of the nodes' settings, which must agree on the frames between the nodes."""
    slam = checked["slam_node"][SlamNodeSettings]
    prediction = checked["imu_prediction_node"][PredictionNodeSettings]
    for name in ("odom_frame", "base_frame"):
        one, other = getattr(prediction, name), getattr(slam, name)
        if one != other:
            raise SettingsError(
                f"{where}{name}: is {one!r} for imu_prediction_node and {other!r} for slam_node: "
                "give both the same"
            )
    return ReadingRules(
        frames=Frames(slam.map_frame, slam.odom_frame, slam.base_frame, slam.camera_frame),
        twist_time_jump=checked["imu_prediction_node"][PredictionSettings].time_jump,
        features_time_jump=checked["slam_node"][SlamSettings].time_jump,
        imu_turns=prediction.angular_velocity_source == "imu",
    )


def _checked(
    where: str, node: str, classes: tuple[Any, ...], values: dict[str, Any]
) -> dict[Any, Any]:
    """Settings by class, of one node's parameters; ``where`` begins each error."""
    names = {cls: {field.name for field in dataclasses.fields(cls)} for cls in classes}
    known = set().union(*names.values())
    try:
        for name in sorted(set(values) - known - {"use_sim_time"}):
            raise SettingsError(f"{name}: no such parameter{nearest_name(name, known)}")
        return {
            cls: settings_from_dict(cls, {k: v for k, v in values.items() if k in names[cls]})
            for cls in classes
        }
    except SettingsError as error:
        raise SettingsError(f"{where}{node}: {error}") from error
