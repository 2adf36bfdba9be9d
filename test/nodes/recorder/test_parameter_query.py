# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes a recorder waits for before it says that all have told their parameters."""

import contextlib

import pytest
import rclpy
from live.node_processes import wait_until

from vislam_ros.nodes.recorder.parameter_query import ParameterQuery


@pytest.fixture
def make(context):
    """Make nodes that are there and answer for no parameter."""
    with contextlib.ExitStack() as nodes:

        def make(name, namespace):
            node = rclpy.create_node(
                name, context=context, namespace=namespace, start_parameter_services=False
            )
            nodes.callback(node.destroy_node)
            return node

        yield make


def test_one_that_need_not_be_there_is_waited_for_as_soon_as_it_is_known(make):
    recorder = make("recorder", "/robot")
    query = ParameterQuery(recorder, (), lambda *_: None, if_there=("tracker",))
    make("tracker", "/another_robot")
    known = recorder.get_node_names_and_namespaces
    wait_until(lambda: ("tracker", "/another_robot") in known(), "the other robot's tracker")
    query.ask()
    assert query.complete
    make("tracker", "/robot")
    wait_until(lambda: not query.complete, "its own tracker")
