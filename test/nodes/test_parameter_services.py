# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``ros2 param`` asks of every node and of the player, from another process."""

import ast
import signal

import pytest
from live.node_processes import WAIT, spin_until
from places import REPOSITORY
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python

from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate

NODES = ("imu_prediction_node", "slam_node", "recorder_node", "player")


class Asker(Node):
    """Calls the parameter services of a node as ``ros2 param`` does."""

    def __init__(self, **options):
        super().__init__("asker", **options)
        self.asking = SingleThreadedExecutor(context=self.context)
        self.asking.add_node(self)

    def call(self, node, service, request):
        kinds = {
            "list_parameters": ListParameters,
            "get_parameters": GetParameters,
            "describe_parameters": DescribeParameters,
            "set_parameters": SetParameters,
        }
        client = self.create_client(kinds[service], f"/{node}/{service}")
        spin_until(self.asking, client.service_is_ready, f"{service} of {node}")
        future = client.call_async(request)
        spin_until(self.asking, future.done, f"the answer of {service} of {node}")
        return future.result()

    def dump(self, node):
        names = self.call(node, "list_parameters", ListParameters.Request()).result.names
        values = self.call(node, "get_parameters", GetParameters.Request(names=names)).values
        return dict(zip(names, map(parameter_value_to_python, values), strict=True))

    def set(self, node, name, value):
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        return self.call(node, "set_parameters", request).results[0]


@pytest.fixture
def graph(processes, make_node, tmp_path):
    """The nodes and a paused player, each a process, and who asks them."""
    write_bag(simulate(SimulationSettings(steps=20, landmarks=60)).drive, tmp_path / "bag")
    started = {name: processes.start(f"nodes.{name}") for name in NODES[:2]}
    started["recorder_node"] = processes.start(
        "nodes.recorder_node", "--ros-args", "-p", f"directory:={tmp_path / 'run'}"
    )
    started["player"] = processes.start(
        *("cli.main", "play", str(tmp_path / "bag"), "--wait", "0", "--start-paused"),
        *("--ros-args", "-p", "use_sim_time:=false", "-p", "rat:=2"),
    )
    asker = make_node(Asker)
    yield asker, started
    asker.asking.shutdown()


@pytest.mark.alone
def test_no_node_ends_because_it_is_asked_for_its_parameters(graph):
    asker, started = graph
    dumps = {name: asker.dump(name) for name in NODES}
    assert dumps["imu_prediction_node"]["time_jump"] == 1.0
    assert dumps["slam_node"]["estimator"] == "robocentric"
    assert dumps["recorder_node"]["record_mcap"] is True
    key = "qos_overrides./stereo/features.{}.reliability"
    assert dumps["slam_node"][key.format("subscription")] == "reliable"
    assert dumps["player"][key.format("publisher")] == "reliable"
    for name in NODES:
        request = DescribeParameters.Request(names=list(dumps[name]))
        descriptors = asker.call(name, "describe_parameters", request).descriptors
        assert [one.name for one in descriptors] == list(dumps[name])
        assert asker.set(name, "use_sim_time", True).successful
        assert not asker.set(name, "no_such_parameter", 1).successful
    assert asker.set("slam_node", "path_length", 5).successful
    assert asker.set("slam_node", "chi2_gate", 9.0).successful
    assert asker.dump("slam_node")["chi2_gate"] == 9.0
    for node, parameter, value in (
        ("slam_node", "path_length", -5),
        ("slam_node", "path_length", "short"),
        ("slam_node", "estimator", "joint"),
        ("imu_prediction_node", "time_jump", 2.0),
        ("recorder_node", "directory", "/elsewhere"),
    ):
        result = asker.set(node, parameter, value)
        assert not result.successful
        assert result.reason
    assert asker.dump("slam_node")["path_length"] == 5
    for name, process in started.items():
        assert process.poll() is None, name
    # In simulated time, which nobody tells, they still end as they should.
    for process in started.values():
        process.send_signal(signal.SIGINT)
    for name, process in started.items():
        _, errors = process.communicate(timeout=WAIT)
        assert process.returncode == (130 if name == "player" else 0), errors
        assert "Traceback" not in errors
        if name == "player":
            assert "rat: no such parameter, it has no effect" in errors


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "vislam_ros" / "nodes").rglob("*.py")), ids=lambda path: path.stem
)
def test_no_node_names_an_attribute_that_is_rclpy_s_own(make_node, path):
    plain = make_node(type("Plain", (Node,), {"__init__": plain_init}))
    own = set(dir(plain))
    assert "_parameters" in own
    for cls in ast.walk(ast.parse(path.read_text())):
        if isinstance(cls, ast.ClassDef) and "Node" in {getattr(b, "id", "") for b in cls.bases}:
            named = {
                node.attr
                for node in ast.walk(cls)
                if isinstance(node, ast.Attribute)
                and isinstance(node.ctx, ast.Store)
                and isinstance(node.value, ast.Name)
                and node.value.id == "self"
            }
            assert not named & own, cls.name


def plain_init(self, **options):
    Node.__init__(self, "plain", **options)
