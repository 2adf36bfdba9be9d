# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A type that is made at run time is, for all who hear it, the true one."""

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, TransformStamped
from live.node_processes import spin_until
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from type_description_interfaces.srv import GetTypeDescription

from vislam_ros.data.bags.layout import TRANSFORMS
from vislam_ros.data.results.scene import transform_message
from vislam_ros.nodes.made_types import list_message
from vislam_ros.nodes.made_types.list_message import list_message_class

STORE = get_typestore(Stores.ROS2_JAZZY)
MSGTYPE = TRANSFORMS.msgtype
HASH = STORE.hash_rihs01(MSGTYPE)


@pytest.fixture
def cls():
    made = list_message_class(MSGTYPE, "transforms", TransformStamped)
    if made is None:
        pytest.skip("needs the ROS wheels and Fast DDS; elsewhere tf2_msgs is installed")
    return made


@pytest.fixture
def node(make_node):
    return make_node(plain("sender"))


@pytest.fixture
def other(make_node):
    return make_node(plain("hearer"))


def plain(name):
    class Plain(Node):
        def __init__(self, **options):
            super().__init__(name, **options)

    return Plain


def spun(*nodes):
    executor = SingleThreadedExecutor(context=nodes[0].context)
    for node in nodes:
        executor.add_node(node)
    return executor


def test_its_bytes_arrive_under_the_type_s_own_name_and_hash(cls, node, other):
    heard = []
    publisher = node.create_publisher(cls, "/tf", 10)
    other.create_subscription(cls, "/tf", heard.append, 10, raw=True)
    executor = spun(node, other)
    spin_until(executor, publisher.get_subscription_count, "the subscription")
    sent = transform_message(TRANSFORMS, 5, np.arange(3), (0, 0, 0, 1), "map", "odom").data
    publisher.publish(sent)
    spin_until(executor, lambda: heard, "the message")
    assert heard == [sent]
    (transform,) = STORE.deserialize_cdr(heard[0], MSGTYPE).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "odom")
    (endpoint,) = other.get_publishers_info_by_topic("/tf")
    assert endpoint.topic_type == MSGTYPE
    assert str(endpoint.topic_type_hash) == HASH
    executor.shutdown()


def test_its_description_is_the_type_s_own(cls, node, other):
    node.create_publisher(cls, "/tf", 10)
    client = other.create_client(GetTypeDescription, "/sender/get_type_description")
    executor = spun(node, other)
    spin_until(executor, client.service_is_ready, "the service")
    request = GetTypeDescription.Request(type_name=MSGTYPE, type_hash=HASH)
    future = client.call_async(request)
    spin_until(executor, future.done, "the description")
    response = future.result()
    executor.shutdown()
    assert response.successful, response.failure_reason
    described = response.type_description
    assert described.type_description.type_name == MSGTYPE
    (field,) = described.type_description.fields
    assert field.name == "transforms"
    assert field.type.nested_type_name == "geometry_msgs/msg/TransformStamped"
    names = [one.type_name for one in described.referenced_type_descriptions]
    assert names == sorted(names)
    assert {"geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/Quaternion"} <= set(names)


def test_what_would_convert_a_message_fails(cls, node):
    publisher = node.create_publisher(cls, "/tf", 10)
    with pytest.raises(TypeError):
        publisher.publish(TransformStamped())
    with pytest.raises(AttributeError):
        publisher.publish(cls())
    with pytest.raises(RuntimeError):
        deserialize_message(bytes(200), cls)


@pytest.fixture
def unmade():
    list_message_class.cache_clear()
    yield
    list_message_class.cache_clear()


def test_there_is_none_for_another_middleware(unmade, monkeypatch):
    monkeypatch.setattr(list_message, "get_rmw_implementation_identifier", lambda: "rmw_other")
    assert list_message_class(MSGTYPE, "transforms", TransformStamped) is None


def test_there_is_none_where_structures_do_not_read_as_they_should(unmade, monkeypatch):
    class Others:
        @staticmethod
        def hash_rihs01(_msgtype):
            return "RIHS01_" + 64 * "0"

    monkeypatch.setattr(list_message, "get_typestore", lambda _store: Others)
    assert list_message_class(MSGTYPE, "transforms", PointStamped) is None
