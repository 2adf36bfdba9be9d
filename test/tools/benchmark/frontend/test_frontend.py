# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The front end's stages are measured, and its tracks judged by the noise that they state."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from benchmark.frontend.image_sets import image_sets, wall
from benchmark.frontend.stage_times import measure_frontend
from benchmark.frontend.track_quality import quality
from numerics import CAMERA

from vislam_ros.core.geometry import se3
from vislam_ros.frontend import tracker
from vislam_ros.frontend.tracker import Tracked


def test_stages_make_up_a_frame() -> None:
    before = vars(tracker).copy()
    images = wall(3, size=(320, 240), features=40)
    report = measure_frontend([images], repeats=1)
    (row,) = report["frontend"]
    assert row["size"] == "320 x 240"
    assert row["observations"] > 20
    assert row["frame_ms"] > 0
    assert row["ratio"] == pytest.approx(row["frame_ms"] / row["floor_ms"])
    assert len(report["frontend_stages"]) == 10
    assert 0.5 < sum(stage["share"] for stage in report["frontend_stages"]) < 1.5
    # What was measured is as it was before.
    assert vars(tracker) == before


def test_without_recorded_images_there_are_simulated_ones(tmp_path: Path) -> None:
    (images,) = image_sets(tmp_path / "data", 2)
    assert images.name == "a wall, simulated"
    assert images.size == (752, 480)


@pytest.mark.parametrize("understated", [1.0, 3.0])
def test_residuals_are_whitened_by_the_stated_noise(understated: float) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-10, -3, 5], [10, 3, 60], (150, 3))
    frames = []
    for k in range(4):
        T = se3.exp(k * np.array([0.02, 0.01, -0.8, 0.001, 0.02, 0.01]))
        y = CAMERA.project(points @ T[:3, :3].T + T[:3, 3])[:, [0, 2, 1, 2]]
        seen = (y + rng.normal(0, 0.2, y.shape)).astype(np.float32)
        # A tenth of the tracks go astray in each frame.
        seen[rng.random(150) < 0.1] += 30
        noise = np.full(150, 0.2 / understated, np.float32)
        frames.append(Tracked(np.arange(150, dtype=np.uint32), seen, noise))
    judged = quality(CAMERA, frames)
    assert judged["whitened"] == pytest.approx(understated, rel=0.3)
    assert judged["beyond"] > 0.1
    assert judged["length"] == 4
    without = [
        dataclasses.replace(frame, ids=frame.ids + 200 * k) for k, frame in enumerate(frames)
    ]
    assert (
        quality(CAMERA, [Tracked(f.ids, f.pixels, f.noise) for f in without])["whitened"] is None
    )
