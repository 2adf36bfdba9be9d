# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A tracker of your own as a node: it publishes what it finds, and slam_node takes it."""

import array
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2, PointField

NAMES = ("id", "u_left", "v_left", "u_right", "v_right")
POINT = np.dtype([(name, "<f4" if k else "<u4") for k, name in enumerate(NAMES)])
FIELDS = [
    PointField(
        name=name,
        offset=4 * k,
        datatype=PointField.FLOAT32 if k else PointField.UINT32,
        count=1,
    )
    for k, name in enumerate(NAMES)
]


class MyTracker(Node):
    """Publishes ids (n,) and pixels (n, 4) in the rectified images, as ``find`` gives them."""

    def __init__(self, find: Callable[[Image], tuple[Any, Any]], **options: Any):
        super().__init__("my_tracker", **options)
        self._find = find
        self.features = self.create_publisher(PointCloud2, "stereo/features", 10)
        self.create_subscription(Image, "stereo/left/image_raw", self.on_image, 10)

    def on_image(self, image: Image) -> None:
        """Publish the features of an image, under its stamp."""
        ids, pixels = self._find(image)
        points = np.empty(len(ids), POINT)
        points["id"] = ids
        for name, column in zip(NAMES[1:], np.transpose(pixels), strict=True):
            points[name] = column
        cloud = PointCloud2(header=image.header, height=1, width=len(points), fields=FIELDS)
        cloud.header.frame_id = "camera_left_optical"
        cloud.point_step, cloud.row_step = POINT.itemsize, points.nbytes
        cloud.data = array.array("B", points.tobytes())
        self.features.publish(cloud)
