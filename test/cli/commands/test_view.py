# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest
from imagery.folders import write_asl

from vislam_ros.cli.main import main


def vislam(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_asl(tmp_path_factory.mktemp("images") / "drive")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory, images: Path) -> Path:
    path = tmp_path_factory.mktemp("solved") / "results"
    assert vislam("solve", images, "--out", path) == 0
    return path


def entities(path: Path) -> set[str]:
    chunks = pytest.importorskip("rerun.chunk", reason="the extra view is not installed")
    return {chunk.entity_path for chunk in chunks.RrdReader(path).stream()}


def test_a_recording_has_the_images_and_tracks_that_were_solved(
    solved: Path, images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun.chunk", reason="the extra view is not installed")
    path = tmp_path / "results.rrd"
    capsys.readouterr()
    assert vislam("view", solved, "--data", images, "--save", path) == 0
    assert capsys.readouterr().out.split() == [str(path)]
    assert {"/camera/left", "/camera/left/tracks", "/world/estimate"} <= entities(path)
    assert vislam("view", solved, "--save", path) == 1
    assert "exists already" in capsys.readouterr().err
    assert vislam("view", solved, "--save", path, "--force") == 0
    assert "/camera/left/tracks" not in entities(path)


def test_data_of_another_drive_are_refused(
    solved: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rerun", reason="the extra view is not installed")
    path = tmp_path / "results.rrd"
    capsys.readouterr()
    assert vislam("view", solved, "--data", dataset, "--save", path) == 1
    assert "is it what was solved?" in capsys.readouterr().err
    assert not path.exists()


@pytest.mark.parametrize("command", ["view", "run"])
def test_without_a_screen_nothing_is_begun(
    command: str,
    solved: Path,
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("rerun", reason="the extra view is not installed")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    capsys.readouterr()
    out = tmp_path / "run"
    argv = ("view", solved) if command == "view" else ("run", dataset, "--out", out, "--view")
    assert vislam(*argv) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: there is no screen for the viewer")
    assert not out.exists()
