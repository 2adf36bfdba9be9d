# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What one bad stamp costs the session: its message."""

import itertools

import numpy as np
import pytest
from numerics import CAMERA
from scenes import passing_scene

from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam

STEP = 100_000_000
BEGIN = 5000 * STEP
SCENE = passing_scene(21, steps=12)


def messages(begin):
    """Predictions and features of a scene, as arguments of the session's methods."""
    T, predictions, features = np.eye(4), [], []
    for k, (increment, frame) in enumerate(zip(SCENE.increments, SCENE.frames, strict=True)):
        T = T @ increment.T
        stamp = begin + k * STEP
        predictions.append((stamp, T[:3, 3].copy(), se3.quaternion_from_rotation(T[:3, :3])))
        features.append((stamp, frame.keys.astype(np.uint32), frame.pixels.astype(np.float32)))
    return predictions, features


class Session:
    """A session and the poses that it gave, to the last bit."""

    def __init__(self):
        self.slam = Slam(SlamSettings())
        self.slam.set_camera(CAMERA)

    def hear(self, predictions, features):
        """Poses that come of the messages, a prediction before each frame."""
        steps = []
        for prediction, frame in itertools.zip_longest(predictions, features):
            steps += self.slam.add_prediction(*prediction) if prediction else []
            steps += self.slam.add_features(*frame) if frame else []
        return [(step.stamp, step.position.tobytes(), step.covariance.tobytes()) for step in steps]


@pytest.mark.parametrize("stream", ["features", "prediction"])
@pytest.mark.parametrize("bad", [0, BEGIN - 11 * STEP, BEGIN - 36_000 * STEP, 2 * 10**18])
@pytest.mark.parametrize("place", [0, 1, 6])
def test_a_bad_stamp_costs_its_message_and_the_next_pass_is_clean(stream, bad, place):
    spoilt, without = Session(), Session()
    for session, kept in ((spoilt, True), (without, False)):
        told = dict(zip(("prediction", "features"), messages(BEGIN), strict=True))
        good = told[stream]
        told[stream] = [*good[:place], *[(bad, *good[place][1:])] * kept, *good[place + 1 :]]
        session.poses = session.hear(told["prediction"], told["features"])
        session.again = session.hear(*messages(0))
    assert spoilt.poses == without.poses
    news = spoilt.slam.refused.counts - without.slam.refused.counts
    assert news == {f"{stream}_bad_stamp": 1}
    assert spoilt.again == without.again == Session().hear(*messages(0))
    assert spoilt.slam.resets == 1
