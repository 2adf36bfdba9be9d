# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a bag calls the topics of a drive."""

import pytest

from vislam_ros.data.bags.layout import FEATURES, TWIST
from vislam_ros.data.bags.naming import hint, names_in_bag, namespace_of, played_name
from vislam_ros.errors import VislamError

PLAIN = ["/imu/twist", "/stereo/features"]
FLEET = ["/one/imu/twist", "/one/stereo/features", "/two/imu/twist", "/tf"]


@pytest.mark.parametrize(
    ("text", "namespace"), [("", ""), ("/", ""), ("one", "/one"), ("/a/b_2/", "/a/b_2")]
)
def test_a_namespace_is_absolute_or_empty(text, namespace):
    assert namespace_of(text) == namespace


@pytest.mark.parametrize("text", ["a b", "a-b", "2fast", "a//b", "a:=b"])
def test_what_is_no_namespace_is_refused(text):
    with pytest.raises(VislamError, match="is none"):
        namespace_of(text)


@pytest.mark.parametrize(
    ("recorded", "namespace", "name"),
    [
        (PLAIN, "", "/imu/twist"),
        (PLAIN, "/one", "/imu/twist"),
        (FLEET, "/one", "/one/imu/twist"),
        (FLEET, "/two", "/two/imu/twist"),
        (FLEET, "/on", "/imu/twist"),
    ],
)
def test_a_topic_lies_in_the_namespace_if_the_bag_has_that(recorded, namespace, name):
    assert names_in_bag([TWIST, FEATURES], recorded, namespace)[TWIST] == name


@pytest.mark.parametrize(
    ("namespace", "ours", "name", "found"),
    [
        ("", "imu/twist", "/speed", "/speed"),
        ("", "/imu/twist", "speed", "/speed"),
        ("/one", "imu/twist", "speed", "/one/speed"),
        ("/one", "/one/imu/twist", "/speed", "/speed"),
    ],
)
def test_another_name_is_relative_to_the_namespace_or_absolute(namespace, ours, name, found):
    names = names_in_bag([TWIST, FEATURES], FLEET, namespace, {ours: name})
    assert names == {TWIST: found, FEATURES: f"{namespace}/stereo/features"}


def test_a_bag_is_played_in_a_namespace_where_it_does_not_lie_yet():
    assert [played_name(name, PLAIN, "/one") for name in PLAIN] == [
        "/one/imu/twist",
        "/one/stereo/features",
    ]
    assert [played_name(name, FLEET, "/one") for name in FLEET] == FLEET
    assert [played_name(name, PLAIN, "") for name in PLAIN] == PLAIN
    assert played_name("/tf_static", PLAIN, "/one") == "/tf_static"


def test_a_hint_names_the_namespaces_or_the_topics():
    assert hint(TWIST, FLEET).startswith("it has it in the namespace /one and /two: ")
    assert hint(FEATURES, FLEET).startswith("it has it in the namespace /one: ")
    assert hint(TWIST, ["/b", "/a"]) == (
        "give one that it has with --remap imu/twist:=NAME: /a, /b"
    )
