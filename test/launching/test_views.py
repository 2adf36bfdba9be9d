# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``config/vislam.rviz`` and ``config/vislam.foxglove.json`` show what there is to see."""

import json
import re
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import pytest
import yaml
from places import REPOSITORY
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags import layout
from vislam_ros.nodes.launch_plan import SHOWN

RVIZ = yaml.safe_load((REPOSITORY / "config" / "vislam.rviz").read_text())
FOXGLOVE = json.loads((REPOSITORY / "config" / "vislam.foxglove.json").read_text())
TOPICS = {
    topic.recorded: topic for topic in vars(layout).values() if isinstance(topic, layout.Topic)
}
FRAMES = set(asdict(layout.DEFAULT_FRAMES).values())
TYPES = {
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
    "rviz_default_plugins/Path": "nav_msgs/msg/Path",
    "rviz_default_plugins/PointCloud2": "sensor_msgs/msg/PointCloud2",
    "rviz_default_plugins/Image": "sensor_msgs/msg/Image",
}
DISPLAYS = RVIZ["Visualization Manager"]["Displays"]
WITH_TOPIC = [display for display in DISPLAYS if "Topic" in display]


@pytest.mark.parametrize("display", WITH_TOPIC, ids=lambda display: display["Name"])
def test_a_display_of_rviz_takes_a_topic_of_its_type_as_it_is_published(
    display: dict[str, Any],
) -> None:
    topic, said = TOPICS[display["Topic"]["Value"]], display["Topic"]
    assert topic.msgtype == TYPES[display["Class"]]
    latched = said["Durability Policy"] == "Transient Local"
    assert latched == topic.latched
    assert said["Reliability Policy"] == "Reliable"
    # RViz, which is slow, must not hold up the nodes: a queue of theirs would have no end.
    assert said["History Policy"] == "Keep Last"


def test_the_topics_that_a_namespace_moves_are_those_that_rviz_shows() -> None:
    shown = {display["Topic"]["Value"] for display in WITH_TOPIC}
    assert shown == {topic.recorded for topic in SHOWN}


def test_rviz_s_frames_exist_and_covariances_of_orientation_are_fixed() -> None:
    manager = RVIZ["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] in FRAMES
    assert manager["Views"]["Current"]["Target Frame"] in FRAMES
    covariances = [display["Covariance"] for display in DISPLAYS if "Covariance" in display]
    assert len(covariances) == 3
    assert {covariance["Orientation"]["Frame"] for covariance in covariances} == {"Fixed"}


def panels(layout_of: Any) -> Iterator[str]:
    if isinstance(layout_of, str):
        yield layout_of
    else:
        yield from panels(layout_of["first"])
        yield from panels(layout_of["second"])


def test_every_panel_of_foxglove_is_configured_and_shown() -> None:
    assert sorted(panels(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])


def test_foxglove_s_scene_names_topics_and_frames_that_exist() -> None:
    scene = FOXGLOVE["configById"]["3D!vislam"]
    assert scene["topics"].keys() <= TOPICS.keys()
    assert scene["followTf"] in FRAMES
    assert {name.removeprefix("frame:") for name in scene["transforms"]} <= FRAMES
    image = FOXGLOVE["configById"]["Image!tracks"]["imageMode"]["imageTopic"]
    assert TOPICS[image].msgtype == "sensor_msgs/msg/Image"
    for panel, configured in FOXGLOVE["configById"].items():
        if panel.startswith("DiagnosticSummary!"):
            assert configured["topicToRender"] == layout.DIAGNOSTICS.recorded


PATHS = [
    path["value"]
    for name, panel in FOXGLOVE["configById"].items()
    if name.startswith("Plot!")
    for path in panel["paths"]
]


DEFINITIONS = get_typestore(Stores.ROS2_JAZZY).fielddefs


def inner_type(description: Any) -> str:
    """Name of a field's type or, of a list, that of its items."""
    kind, content = description
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return inner_type(content[0])
    return str(content if kind == Nodetype.NAME else content[0])


@pytest.mark.parametrize("path", PATHS)
def test_a_plot_of_foxglove_follows_fields_of_its_topic_s_type(path: str) -> None:
    topic, *steps = re.sub(r"\[[^]]*\]|{[^}]*}|\.@sqrt$", "", path).split(".")
    msgtype = TOPICS[topic].msgtype
    for step in steps:
        fields = dict(DEFINITIONS[msgtype][1])
        assert step in fields, f"{msgtype} has no {step}"
        msgtype = inner_type(fields[step])
    assert msgtype in {"float64", "string"}
