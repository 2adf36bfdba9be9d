# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A rig in messages is the rig, to rounding; and what is heard of it is one thing, to the bit."""

from pathlib import Path

import numpy as np
import pytest
from imagery.folders import STAMPS, T_BODY_LEFT, K, write_asl

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.data.conversion import convert
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.told_rig import ToldRig
from vislam_ros.frontend.rectification import Rectification

SIZE = (160, 120)


def rig(model: str = "plumb_bob", D: tuple[float, ...] = (-0.1, 0.02, 1e-4, -2e-4)) -> StereoRig:
    T = se3.exp(np.array([0.1, 0.002, -0.003, 0.01, -0.02, 0.015]))
    left = RawCamera(SIZE, K, model, np.array(D))
    right = RawCamera(SIZE, K * np.array([[1.01], [0.99], [1.0]]), model, np.array(D) * 0.9)
    return StereoRig(left, right, T, T_BODY_LEFT)


@pytest.mark.parametrize(
    "given",
    [
        rig(),
        rig("equidistant", (0.01, -0.002, 0.0, 0.0)),
        rig("equidistant", (0.0,) * 4),
        rig("", ()),
    ],
)
def test_what_is_heard_is_the_rig_to_rounding(given: StereoRig) -> None:
    heard = ToldRig.of(given).heard()
    for side in ("left", "right"):
        ours, theirs = getattr(given, side), getattr(heard, side)
        assert ours.image_size == theirs.image_size
        assert ours.distortion_model == theirs.distortion_model
        np.testing.assert_array_equal(ours.K, theirs.K)
        np.testing.assert_array_equal(ours.D, theirs.D)
    np.testing.assert_allclose(heard.T_left_right, given.T_left_right, atol=1e-14)
    np.testing.assert_allclose(heard.T_body_left, given.T_body_left, atol=1e-14)


def test_messages_tell_the_rectified_pair_as_ros_has_it() -> None:
    given = rig()
    told, camera = ToldRig.of(given), Rectification(given).camera
    R_left, R_right = told.left.r.reshape(3, 3), told.right.r.reshape(3, 3)
    # A point of both cameras has one row and the disparity of its depth.
    point = np.array([0.3, -0.2, 4.0])
    in_right = se3.inverse(given.T_left_right) @ [*point, 1.0]
    u, v, w = told.left.p.reshape(3, 4) @ [*(R_left @ point), 1.0]
    right_eye = R_right @ in_right[:3] + [camera.baseline, 0.0, 0.0]
    u_right, v_right, w_right = told.right.p.reshape(3, 4) @ [*right_eye, 1.0]
    assert v / w == pytest.approx(v_right / w_right, abs=1e-9)
    assert u / w - u_right / w_right == pytest.approx(camera.fx_baseline / w)


def test_a_bag_made_of_images_tells_what_they_do(tmp_path: Path) -> None:
    folder, bag = write_asl(tmp_path / "V1_01"), tmp_path / "bag"
    written = convert(folder, bag)
    assert written.steps == len(STAMPS)
    images, again = read_images(folder), read_images(bag)
    assert again.is_of_graph
    heard = ToldRig.of(images.rig).heard()
    assert again.rig.T_left_right.tobytes() == heard.T_left_right.tobytes()
    assert again.rig.T_body_left.tobytes() == heard.T_body_left.tobytes()
    np.testing.assert_array_equal(again.stamps, images.stamps)
    for ours, theirs in zip(images.pairs(), again.pairs(), strict=True):
        np.testing.assert_array_equal(ours.left.pixels, theirs.left.pixels)
        np.testing.assert_array_equal(ours.right.pixels, theirs.right.pixels)
    motion = images.known_motion()
    assert again.motion is not None
    np.testing.assert_array_equal(again.motion.stamps, motion.stamps)
    np.testing.assert_array_equal(again.motion.twists, motion.twists)
