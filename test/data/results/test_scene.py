# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms and the path that ``results.mcap`` holds for viewers."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rosbags.typesys import Stores, get_typestore

from vislam_ros.core.geometry import se3
from vislam_ros.data.bags.layout import PATH, STATIC_TRANSFORMS, TRANSFORMS
from vislam_ros.data.results import scene
from vislam_ros.data.results.scene import Made, Scene, static_transform

STORE = get_typestore(Stores.ROS2_JAZZY)
STEP = 100_000_000
RNG = np.random.default_rng(3)
DRIVEN = np.array([1.0, 0, 0, 0, 0, 0.1])
T_ODOM_BASE = [se3.exp(RNG.normal(0, 0.3, 6) + k * DRIVEN) for k in range(12)]
T_MAP_BASE = [se3.exp(RNG.normal(0, 0.1, 6)) @ T for T in T_ODOM_BASE]


def parts(T: Any) -> tuple[Any, Any]:
    return T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])


def decoded(made: Made) -> Any:
    return STORE.deserialize_cdr(made.data, made.topic.msgtype)


def transforms(made: list[Made]) -> list[tuple[str, str, int, Any]]:
    """Parent, child, stamp and matrix of all transforms."""
    found = []
    for one in made:
        if one.topic is TRANSFORMS:
            (message,) = decoded(one).transforms
            t, q = message.transform.translation, message.transform.rotation
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            assert stamp == one.stamp
            T = se3.pose_matrix((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
            found.append((message.header.frame_id, message.child_frame_id, stamp, T))
    return found


def predict(maker: Scene, k: float, T: Any) -> list[Made]:
    return list(maker.add_prediction(round(k * STEP), *parts(T), "odom", "base_link"))


def step(maker: Scene, k: float, T: Any) -> list[Made]:
    return list(maker.add_step(round(k * STEP), *parts(T), "map", "base_link"))


@pytest.mark.parametrize("late", [False, True], ids=["prediction first", "step first"])
def test_the_tree_leads_from_the_map_over_odom_to_the_estimated_body(late: bool) -> None:
    maker, made = Scene(), []
    for k, (T_map_base, T_odom_base) in enumerate(zip(T_MAP_BASE, T_ODOM_BASE, strict=True)):
        if late:
            made += step(maker, k, T_map_base) + predict(maker, k, T_odom_base)
        else:
            made += predict(maker, k, T_odom_base) + step(maker, k, T_map_base)
    of = {(parent, child, stamp): T for parent, child, stamp, T in transforms(made)}
    assert len(of) == 2 * len(T_MAP_BASE)
    for k, T_map_base in enumerate(T_MAP_BASE):
        T_map_odom = of["map", "odom", k * STEP]
        assert_allclose(T_map_odom @ of["odom", "base_link", k * STEP], T_map_base, atol=1e-9)


def test_a_step_between_two_predictions_takes_the_pose_between_them() -> None:
    maker = Scene()
    made = predict(maker, 0, T_ODOM_BASE[0]) + step(maker, 0.25, T_MAP_BASE[0])
    assert len(transforms(made)) == 1
    made = predict(maker, 1, T_ODOM_BASE[1])
    between = se3.interpolate(T_ODOM_BASE[0], T_ODOM_BASE[1], 0.25)
    (T,) = (T for parent, *_, T in transforms(made) if parent == "map")
    assert_allclose(T @ between, T_MAP_BASE[0], atol=1e-9)


def test_a_step_before_all_predictions_has_no_transform_and_holds_up_none() -> None:
    maker = Scene()
    made = step(maker, 0, T_MAP_BASE[0]) + step(maker, 2, T_MAP_BASE[1])
    made += predict(maker, 1, T_ODOM_BASE[0]) + predict(maker, 2, T_ODOM_BASE[1])
    assert [stamp for parent, _, stamp, _ in transforms(made) if parent == "map"] == [2 * STEP]


def test_what_is_no_pose_makes_nothing() -> None:
    maker = Scene()
    broken = np.full(3, np.nan), np.array([0.0, 0.0, 0.0, 1.0])
    assert not list(maker.add_prediction(0, *broken, "odom", "base_link"))
    assert not list(maker.add_step(0, *broken, "map", "base_link"))
    assert not list(maker.finish())


def paths(made: list[Made]) -> list[Any]:
    return [decoded(one) for one in made if one.topic is PATH]


def test_the_path_grows_with_the_drive_and_is_whole_at_its_end() -> None:
    maker, made = Scene(), []
    for k in range(100):
        made += step(maker, k, T_MAP_BASE[k % 12])
    lengths = [len(path.poses) for path in paths(made)]
    assert lengths[0] < 10
    assert len(lengths) < 20
    (last,) = paths(list(maker.finish()))
    assert len(last.poses) == 100
    assert last.header.frame_id == "map"
    assert last.poses[7].pose.position.x == T_MAP_BASE[7][0, 3]
    assert not list(maker.finish())


def test_a_long_path_is_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene, "_MOST_OF_A_PATH", 16)
    maker = Scene()
    for k in range(100):
        step(maker, k, T_MAP_BASE[0])
    (path,) = paths(list(maker.finish()))
    stamps = [
        pose.header.stamp.sec * 10 + pose.header.stamp.nanosec // STEP for pose in path.poses
    ]
    assert 8 <= len(stamps) <= 16
    assert len(set(np.diff(stamps))) == 1
    assert stamps[0] == 0


def test_what_waits_for_its_counterpart_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene, "_MOST_WAITING", 4)
    maker = Scene()
    for k in range(10):
        step(maker, k, T_MAP_BASE[0])
    made = predict(maker, 0, T_ODOM_BASE[0]) + predict(maker, 20, T_ODOM_BASE[1])
    assert len([1 for parent, *_ in transforms(made) if parent == "map"]) == 4


def test_the_extrinsics_are_a_static_transform() -> None:
    made = static_transform(7, *parts(T_MAP_BASE[1]), "base_link", "camera_left_optical")
    assert made.topic is STATIC_TRANSFORMS
    (message,) = decoded(made).transforms
    assert (message.header.frame_id, message.child_frame_id) == (
        "base_link",
        "camera_left_optical",
    )
    assert message.transform.translation.x == T_MAP_BASE[1][0, 3]
