# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What tells whether the graph keeps up, how long its hops take, and whether its memory grows."""

import dataclasses
import os
import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from reliability.load.curve import CurvePoint, drive_with, largest_rates
from reliability.load.images import measure_images
from reliability.load.latency import Heard, Percentiles, hops, whole_latency
from reliability.load.offline import offline_trajectory
from reliability.load.pace import paced_steps
from reliability.load.pictures import draw_curve, draw_soak
from reliability.load.play import play_heard
from reliability.load.processes import cpu_seconds, growth, resident_mb
from reliability.load.soak import Soak, soak

from vislam_ros.cli.running.modules import NODES
from vislam_ros.data.bags.layout import FEATURES, ODOMETRY, PREDICTION, STEPS, TWIST
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.simulation.images.folder import write_image_folder
from vislam_ros.data.simulation.images.simulated import simulate_images

FRAMES = 100
POINT = CurvePoint(
    features=50.0,
    size=1000.0,
    rate=10.0,
    frames=100,
    answered=100,
    latency_ms=199.0,
    worst_ms=300.0,
)


def test_a_graph_keeps_up_while_fewer_than_two_frames_wait() -> None:
    assert POINT.keeps_up
    assert not dataclasses.replace(POINT, latency_ms=201.0).keeps_up
    assert not dataclasses.replace(POINT, latency_ms=101.0, rate=20.0).keeps_up
    assert not dataclasses.replace(POINT, answered=99).keeps_up
    assert not dataclasses.replace(POINT, answered=0, latency_ms=float("nan")).keeps_up


def test_a_rate_counts_where_each_lower_one_is_kept_up_with() -> None:
    fast = dataclasses.replace(POINT, rate=20.0, latency_ms=5.0)
    faster = dataclasses.replace(POINT, rate=30.0, latency_ms=5.0)
    assert largest_rates([faster, POINT, fast]) == {50.0: 30.0}
    assert largest_rates([faster, POINT, dataclasses.replace(fast, answered=3)]) == {50.0: 10.0}
    assert largest_rates([dataclasses.replace(POINT, answered=3)]) == {50.0: 0.0}


def test_a_drive_has_about_the_features_that_it_should() -> None:
    drive = drive_with(120, 100)
    assert 0.7 < len(drive.ids) / drive.steps / 120 < 1.1


def test_a_hop_is_the_time_between_two_clocks() -> None:
    million = 1_000_000
    messages = {
        TWIST.name: {1: Heard(0, 0, 0, 0.0)},
        PREDICTION.name: {1: Heard(2 * million, 0, 0, 0.0)},
        FEATURES.name: {1: Heard(million, 0, 0, 0.0), 2: Heard(million, 0, 0, 0.0)},
        STEPS.name: {1: Heard(0, 0, 0, 4.0)},
        ODOMETRY.name: {1: Heard(6 * million, 9 * million, 0, 0.0)},
    }
    assert [hop.p50 for hop in hops(messages).values()] == [2.0, 1.0, 4.0, 3.0, 8.0]
    assert whole_latency(messages).tolist() == [8.0]


def test_percentiles_are_of_all_values() -> None:
    found = Percentiles.of(np.arange(101.0))
    assert (found.p50, found.p99, found.largest, found.count) == (50.0, 99.0, 100.0, 101)
    assert Percentiles.of(np.array([])).count == 0


def test_the_step_alone_is_timed_over_the_seconds_asked_for_and_at_the_drives_pace() -> None:
    drive = drive_with(30, 20)  # at 10 Hz
    began = time.monotonic()
    found = paced_steps(drive, 0.95)
    assert time.monotonic() - began > 0.9
    assert [steps.count for steps in found.values()] == [10, 10]
    assert all(0.0 < steps.p50 <= steps.largest for steps in found.values())


def test_growth_is_the_slope_after_the_warm_up() -> None:
    seconds = np.arange(100.0)
    megabytes = np.where(seconds < 50.0, 10.0 * seconds, 500.0 + 0.01 * seconds)
    assert growth(seconds, megabytes, 50.0) == pytest.approx(6.0)
    assert growth(seconds, megabytes, 0.0) > 1000.0
    assert np.isnan(growth(seconds, megabytes, 99.0))


def test_a_soak_holds_where_memory_is_flat_and_each_pass_the_same() -> None:
    seconds = list(np.arange(0.0, 1200.0, 10.0))
    flat = Soak(300.0, seconds, {"slam_node": [100.0] * len(seconds)}, passes=3, same=3)
    assert flat.holds
    grown = [100.0 + 1.01 * second / 600.0 for second in seconds]
    assert not dataclasses.replace(flat, megabytes={"slam_node": grown}).holds
    assert not dataclasses.replace(flat, same=2).holds
    assert not dataclasses.replace(flat, passes=0, same=0).holds
    assert not dataclasses.replace(flat, broken=["pass 2: lost"]).holds


def test_memory_and_cpu_are_the_kernels() -> None:
    assert 10.0 < resident_mb(os.getpid()) < 10_000.0
    before = cpu_seconds(os.getpid())
    while cpu_seconds(os.getpid()) == before:
        pass
    assert 0.0 < cpu_seconds(os.getpid()) - before < 1.0


def test_pictures_can_be_drawn_of_what_was_measured(tmp_path: Path) -> None:
    seen = Soak(1.0, [0.0, 1.0, 2.0], {"slam_node": [1.0, 2.0, 2.0]}, passes=1, same=1)
    for picture in (draw_soak(seen), draw_curve([POINT])):
        (tmp_path / "picture.png").write_bytes(picture)
        assert imread(tmp_path / "picture.png").std() > 0.0


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("load") / "bag"
    write_bag(drive_with(30, FRAMES), path)
    return path


def test_a_listener_hears_each_frame_and_each_process_costs(bag: Path, tmp_path: Path) -> None:
    played = play_heard(bag, tmp_path / "run", 2.0)
    found = hops(played.messages)
    assert [hop.count for hop in found.values()][1:] == [FRAMES] * 4
    # The clocks of two processes meet in a hop: one that is short may seem to take no time.
    assert all(hop.p50 <= hop.p99 <= hop.largest for hop in found.values())
    assert found["features published → odometry heard"].p50 > 0.0
    assert played.cpu.keys() == {*NODES, "player"}
    assert played.cpu["slam_node"] > 0.0


def test_passes_of_a_soak_are_held_against_the_offline_estimate(bag: Path, tmp_path: Path) -> None:
    offline = offline_trajectory(bag, tmp_path / "offline")
    assert offline.count(b"\n") == FRAMES
    seen = soak(bag, offline, tmp_path / "run", 0.0, lambda seen: seen.passes < 2)
    assert (seen.passes, seen.broken) == (seen.same, [])
    assert set(seen.megabytes) == {*NODES, "player"}
    assert min(map(min, seen.megabytes.values())) > 10.0


def test_every_image_that_was_heard_is_answered_and_its_latency_told(tmp_path: Path) -> None:
    images = tmp_path / "street"
    write_image_folder(
        images, simulate_images(scene="street", seconds=2.0, rate=10.0, scale=0.5, seed=3)
    )
    latency = measure_images(images, tmp_path / "run")
    assert latency.complete
    assert latency.steps == 21
    assert 0 < latency.whole.count <= latency.heard <= latency.steps
    assert 0 < latency.settled.count < latency.whole.count
    assert 0 < latency.whole.p50 <= latency.whole.largest
