# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What nodes and player are told of a bag, so that they speak of the same topics."""

from pathlib import Path

from vislam_ros.cli.played_bag import PlayedBag
from vislam_ros.data.bags.layout import TOPICS
from vislam_ros.data.bags.naming import names_in_bag


def played(recorded: list[str], namespace: str, renamed: dict[str, str]) -> PlayedBag:
    names = names_in_bag(TOPICS, recorded, namespace, renamed)
    return PlayedBag(Path("bag"), namespace, names, dict.fromkeys(recorded, 7))


def test_a_plain_bag_needs_no_words() -> None:
    bag = played(["/imu/twist", "/stereo/features"], "", {})
    assert (bag.node_arguments, bag.player_arguments, bag.frames) == ([], [], 7)


def test_nodes_and_player_share_a_namespace() -> None:
    for recorded in (["/imu/twist"], ["/one/imu/twist"]):
        bag = played(recorded, "/one", {})
        assert bag.node_arguments == ["-r", "__ns:=/one"]
        assert bag.player_arguments == ["--namespace=/one"]


def test_a_topic_of_another_name_is_played_under_ours_and_what_had_it_is_left_out() -> None:
    bag = played(["/imu/twist", "/speed", "/other"], "", {"imu/twist": "/speed"})
    assert bag.player_arguments == [
        *("--topics", "/other", "/speed"),
        *("--remap", "/speed:=/imu/twist"),
    ]


def test_other_names_in_a_namespace() -> None:
    bag = played(["/one/speed", "/two/speed"], "/one", {"imu/twist": "speed"})
    assert bag.player_arguments == [
        "--namespace=/one",
        *("--topics", "/one/speed", "/two/speed"),
        *("--remap", "/one/speed:=/one/imu/twist"),
    ]
