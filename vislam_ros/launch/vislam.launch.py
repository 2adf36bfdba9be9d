# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole graph: the nodes, and on request the tracker, a recorder, a player and RViz.

ros2 launch vislam_ros vislam.launch.py                                 on a robot
ros2 launch vislam_ros vislam.launch.py bag:=drive_bag rviz:=true       a replay
ros2 launch vislam_ros vislam.launch.py --show-args                     all arguments
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from vislam_ros.nodes.launch_plan import arguments, planned

ARGUMENTS = arguments(Path(get_package_share_directory("vislam_ros")))


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, and start what they ask for."""
    declared = [
        DeclareLaunchArgument(
            name,
            default_value=argument.default,
            description=argument.description,
            choices=argument.choices or None,
        )
        for name, argument in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """Node actions for the values that the arguments have."""
    values = {name: context.launch_configurations[name] for name in ARGUMENTS}
    return [
        Node(
            package=process.package,
            executable=process.executable,
            namespace=process.namespace,
            parameters=[process.parameters] if process.parameters else None,
            arguments=list(process.arguments),
            remappings=list(process.remappings),
            ros_arguments=list(process.ros_arguments),
            output="screen",
            emulate_tty=True,
            sigterm_timeout=str(process.patience),
        )
        for process in planned(values)
    ]
