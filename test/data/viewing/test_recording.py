# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for the viewer, read back with Rerun's own tools."""

import dataclasses
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from imagery.folders import write_asl
from viewing_recorded import Recorded

from vislam_ros.core.geometry import se3
from vislam_ros.data.drive import Drive
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.data.viewing.frames import log_images, log_tracks
from vislam_ros.data.viewing.results import log_results
from vislam_ros.data.viewing.stream import opened_stream
from vislam_ros.data.viewing.world import ellipsoids, landmark_colours
from vislam_ros.errors import OutputError, VislamError


@pytest.fixture
def _rerun() -> None:
    pytest.importorskip("rerun.chunk", reason="the extra view is not installed")


@pytest.mark.usefixtures("_rerun")
def test_paths_map_and_charts_come_back(
    round_results: Results,
    round_drive: Trajectory,
    moved_round: Trajectory,
    tmp_path: Path,
) -> None:
    path = tmp_path / "new" / "round.rrd"
    with opened_stream("round", path) as stream:
        log_results(stream, round_results, moved_round)
    recorded = Recorded(path)
    for name in ("estimate", "reference"):
        strip = recorded[f"/world/{name}", "LineStrips3D:strips"][0, 0]
        np.testing.assert_allclose(strip, round_drive.positions, atol=1e-5)
    points = recorded["/world/landmarks", "Points3D:positions"][0]
    assert round_results.landmarks is not None
    np.testing.assert_allclose(points, round_results.landmarks.positions, rtol=1e-6)
    body = recorded["/world/body", "Transform3D:translation"][:, 0]
    np.testing.assert_allclose(body, round_drive.positions, atol=1e-5)
    np.testing.assert_allclose(recorded.seconds["/world/body"], 0.1 * np.arange(60), atol=1e-9)
    half_sizes = recorded["/world/position_covariance", "Ellipsoids3D:half_sizes"][-1, 0]
    np.testing.assert_allclose(np.sort(half_sizes), [1.5, 3.0, 6.0], rtol=1e-5)  # 3 sigma
    used = recorded["/series/landmarks/used", "Scalars:scalars"][:, 0]
    steps = round_results.steps
    np.testing.assert_array_equal(used, steps["used"][~steps["frozen"]])
    bias = recorded["/series/gyro_bias/x", "Scalars:scalars"][:, 0]
    np.testing.assert_array_equal(bias, round_results.steps["gyro_bias_x"])
    assert {"/series/gyro_bias/x_low", "/series/error_yaw/high", "/world/dead_reckoning"} <= (
        recorded.entities
    )
    verdict = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert verdict.returncode == 0, verdict.stderr
    assert "verified without error" in verdict.stdout + verdict.stderr


@pytest.mark.usefixtures("_rerun")
def test_tracks_stand_at_their_frames(small_drive: Drive, tmp_path: Path) -> None:
    origin = int(small_drive.feature_stamps[0])
    with opened_stream("tracks", tmp_path / "tracks.rrd") as stream:
        log_tracks(stream, small_drive, origin)
    recorded = Recorded(tmp_path / "tracks.rrd")
    frames = recorded.columns["/camera/left/tracks", "Points2D:positions"]
    assert len(frames) == small_drive.steps
    for k in (0, 3, small_drive.steps - 1):
        ids, pixels = small_drive.frame(k)
        np.testing.assert_array_equal(np.array(frames[k]).reshape(-1, 2), pixels[:, :2])
        classes = recorded.columns["/camera/left/tracks", "Points2D:class_ids"][k]
        assert classes == ids.tolist()
    assert len(frames[3]) == 0
    stamps = (small_drive.feature_stamps - origin) * 1e-9
    np.testing.assert_allclose(recorded.seconds["/camera/left/tracks"], stamps, atol=1e-8)


@pytest.mark.usefixtures("_rerun")
def test_images_are_logged_as_the_tracks_see_them(tmp_path: Path) -> None:
    images = read_images(write_asl(tmp_path / "drive"))
    drive = tracked_drive(images)
    origin = int(images.stamps[0])
    with opened_stream("images", tmp_path / "images.rrd") as stream:
        shares = list(log_images(stream, images, origin))
    assert shares == [(k + 1) / len(images) for k in range(len(images))]
    recorded = Recorded(tmp_path / "images.rrd")
    blobs = recorded.columns["/camera/left", "EncodedImage:blob"]
    assert len(blobs) == len(images)
    picture = cv2.imdecode(np.array(blobs[0][0], dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == drive.image_size[::-1]
    stamps = (images.stamps - origin) * 1e-9
    np.testing.assert_allclose(recorded.seconds["/camera/left"], stamps, atol=1e-8)


@pytest.mark.usefixtures("_rerun")
def test_a_run_without_map_or_steps_can_be_shown(round_results: Results, tmp_path: Path) -> None:
    steps = {name: column[:0] for name, column in round_results.steps.items()}
    bare = dataclasses.replace(
        round_results,
        landmarks=None,
        steps=steps,
        covariances=np.full_like(round_results.covariances, np.nan),
    )
    with opened_stream("bare", tmp_path / "bare.rrd") as stream:
        log_results(stream, bare)
    entities = Recorded(tmp_path / "bare.rrd").entities
    assert "/world/estimate" in entities
    assert not [name for name in entities if name.startswith(("/series", "/world/landmarks"))]


def opening(*arguments: Any, **options: Any) -> None:
    with opened_stream(*arguments, **options):
        pass


@pytest.mark.usefixtures("_rerun")
def test_a_file_is_whole_or_not_there(round_results: Results, tmp_path: Path) -> None:
    def broken() -> None:
        with opened_stream("broken", tmp_path / "new" / "broken.rrd") as stream:
            log_results(stream, round_results)
            raise KeyError

    with pytest.raises(KeyError):
        broken()
    assert not (tmp_path / "new").exists()
    whole = tmp_path / "whole.rrd"
    whole.write_bytes(b"mine")
    with pytest.raises(VislamError, match=r"whole.rrd: exists already"):
        opening("whole", whole)
    assert whole.read_bytes() == b"mine"
    opening("whole", whole, force=True)
    assert whole.read_bytes().startswith(b"RRF")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OutputError, match="cannot write this file"):
        opening("none", tmp_path / "file" / "none.rrd")


@pytest.mark.usefixtures("_rerun")
def test_without_a_screen_it_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(VislamError, match=r"no screen.*--save FILE.rrd"):
        opening("none")


@pytest.mark.usefixtures("_rerun")
def test_the_viewer_is_the_one_of_this_python_whatever_the_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    started = []

    def spawn(executable_path: str | None, recording: Any) -> None:
        started.append(executable_path)
        raise RuntimeError("no port\nmany more lines")

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("rerun.spawn", spawn)
    with pytest.raises(VislamError, match=r"^the viewer does not start: no port$"):
        opening("round")
    assert started[0] is not None
    assert Path(started[0]).parent == Path(sysconfig.get_path("scripts"))


def test_without_rerun_it_is_told_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(VislamError, match=r"pip install 'vislam_ros\[view\]'"):
        opening("none", tmp_path / "none.rrd")


def test_ellipsoids_have_the_covariance_s_axes() -> None:
    R = se3.exp_rotation([0.3, -0.8, 1.1])
    covariances = np.array([R @ np.diag([4.0, 1.0, 0.25]) @ R.T, np.diag([1.0, 9.0, 4.0])])
    half_sizes, quaternions = ellipsoids(covariances)
    for half, quaternion, covariance in zip(half_sizes, quaternions, covariances, strict=True):
        axes = se3.rotation_from_quaternion(quaternion)
        np.testing.assert_allclose(axes @ np.diag((half / 3) ** 2) @ axes.T, covariance, atol=1e-9)


def test_well_known_landmarks_are_brighter() -> None:
    colours = landmark_colours(np.array([0.01, 0.1, 1.0, 10.0])).astype(int).sum(axis=1)
    assert np.all(np.diff(colours) < 0)
    assert len(np.unique(landmark_colours(np.ones(5)), axis=0)) == 1
