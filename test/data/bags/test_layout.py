# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics are declared once."""

import ast

import pytest
from places import REPOSITORY
from rosbags.typesys import Stores, get_typestore

from vislam_ros.data.bags import layout
from vislam_ros.data.bags.layout import Topic

DECLARED = [value for value in vars(layout).values() if isinstance(value, Topic)]
SOURCES = sorted((REPOSITORY / "vislam_ros").rglob("*.py"))


def texts(path):
    """Texts in a file that are no docstring, with their lines."""
    tree = ast.parse(path.read_text())
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and node.body and isinstance(node.body[0], ast.Expr)
    }
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in docstrings
    ]


def test_no_other_module_writes_a_topics_name():
    names = {name for topic in DECLARED for name in (topic.name, topic.recorded) if "/" in name}
    assert len(names) > 20
    found = [
        f"{path.relative_to(REPOSITORY)}:{line}: {text}"
        for path in SOURCES
        if path.name != "layout.py"
        for line, text in texts(path)
        if text in names
    ]
    assert found == []


def test_no_two_topics_share_a_name():
    assert len({topic.recorded for topic in DECLARED}) == len(DECLARED)


@pytest.mark.parametrize("topic", DECLARED, ids=lambda topic: topic.name)
def test_a_topics_type_exists(topic):
    assert topic.msgtype in get_typestore(Stores.ROS2_JAZZY).types
