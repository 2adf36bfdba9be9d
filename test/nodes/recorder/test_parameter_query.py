# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes a recorder waits for before it says that all have told their parameters."""

import rclpy

from vislam_ros.nodes.recorder.parameter_query import ParameterQuery


def test_one_that_need_not_be_there_is_waited_for_once_it_is_known_to_be(context):
    node = rclpy.create_node("recorder", context=context)
    query = ParameterQuery(node, (), lambda *_: None, if_there=("tracker",))
    query.ask()
    assert query.complete
    query.expect("tracker")
    query.ask()
    assert not query.complete
    node.destroy_node()
