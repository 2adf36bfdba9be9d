# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a reset costs the session: the frames that wait, and they are counted."""

import numpy as np
import pytest
from numerics import CAMERA
from scenes import passing_scene

from vislam_ros.core.geometry import se3
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam

STEP = 100_000_000
SCENE = passing_scene(21, steps=12)


@pytest.mark.parametrize("at", [0, 1, 6])
def test_each_frame_is_answered_or_refused_for_a_reason_also_where_it_waits_at_a_reset(at):
    """Frame ``at`` is the last before the reset; its prediction comes after it."""
    slam, T = Slam(SlamSettings()), np.eye(4)
    slam.set_camera(CAMERA)
    answered = []
    for k, (increment, frame) in enumerate(zip(SCENE.increments, SCENE.frames, strict=True)):
        T, stamp = T @ increment.T, k * STEP
        ids, pixels = frame.keys.astype(np.uint32), frame.pixels.astype(np.float32)
        answered += slam.add_features(stamp, ids, pixels)
        if k == at:
            assert at * STEP in slam.waiting
            waiting = slam.waiting
            slam.reset()
            assert not slam.waiting
        pose = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])
        answered += slam.add_prediction(stamp, *pose)
    assert slam.refused.counts == {"features_reset": len(waiting)}
    assert slam.refused.first_stamps == {"features_reset": waiting[0]}
    assert len(answered) == len(SCENE.frames) - len(waiting)
