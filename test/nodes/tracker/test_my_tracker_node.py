# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The example of a tracker of one's own publishes what slam_node takes."""

import importlib.util
from typing import Any

import numpy as np
from places import REPOSITORY
from sensor_msgs.msg import Image

from vislam_ros.data.bags import decoding
from vislam_ros.data.bags.layout import DEFAULT_FRAMES, FEATURES
from vislam_ros.nodes import conversions
from vislam_ros.nodes.slam_node import SlamNode


def example() -> Any:
    path = REPOSITORY / "docs" / "examples" / "my_tracker_node.py"
    spec = importlib.util.spec_from_file_location("my_tracker_node", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_a_tracker_of_ones_own_publishes_gives_the_steps_of_its_tracks(
    context: Any, make_node: Any, capture: Any, drive: Any, monkeypatch: Any
) -> None:
    seen = [decoding.features(message, DEFAULT_FRAMES)[:3] for message in drive.features]
    by_stamp = {stamp: (ids[::-1], pixels[::-1]) for stamp, ids, pixels in seen}
    node = example().MyTracker(
        lambda image: by_stamp[decoding.stamp_of(image.header)], context=context
    )
    clouds: list[Any] = []
    monkeypatch.setattr(node.features, "publish", clouds.append)
    try:
        for stamp in drive.stamps:
            node.on_image(Image(header=conversions.header(stamp, "left_camera")))
    finally:
        node.destroy_node()
    slam = make_node(SlamNode)
    published = capture(slam)
    drive.calibrate(slam)
    for prediction, cloud in zip(drive.predictions, clouds, strict=True):
        slam.on_prediction(prediction)
        slam.on_features(cloud)
    ids, pixels = decoding.features(clouds[3], DEFAULT_FRAMES)[1:3]
    np.testing.assert_array_equal(ids, seen[3][1])
    np.testing.assert_array_equal(pixels, seen[3][2])
    assert len(published["/slam/odometry"]) == len(drive.stamps)
    assert not slam.monitor.refused.counts
    assert FEATURES.name == "stereo/features"
