# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import sys
from pathlib import Path

import pytest

from vislam_ros.cli.main import main


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory, dataset: Path) -> Path:
    path = tmp_path_factory.mktemp("solved") / "results"
    assert main(["solve", str(dataset), "--out", str(path)]) == 0
    return path


def report(*words: object) -> int:
    return main(["report", *map(str, words)])


def test_a_page_is_written_with_the_findings_that_lie_in_the_directory(
    solved: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("plotly", reason="the extra report is not installed")
    page = tmp_path / "page.html"
    assert report(solved, "--reference", dataset.with_suffix(".tum"), "--output", page) == 0
    assert capsys.readouterr().out.split() == [str(page)]
    text = page.read_text()
    assert "ATE" in text
    assert "Not looked for" in text
    findings = {"findings": [{"name": "stamps", "words": "a gap of 3 s", "advice": "look"}]}
    (solved / "findings.json").write_text(json.dumps(findings))
    try:
        assert report(solved) == 0
    finally:
        (solved / "findings.json").unlink()
    assert "a gap of 3 s" in (solved / "report.html").read_text()


@pytest.mark.parametrize("text", ['{"findings": {}}', "{}", '{"findings": ["words"]}'])
def test_findings_that_are_none_are_refused(
    solved: Path, tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "findings.json"
    path.write_text(text)
    assert report(solved, "--findings", path) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {path}: findings is not a list of objects")


def test_without_plotly_a_line_tells_what_to_install(
    solved: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("plotly", "plotly.graph_objects", "plotly.io", "plotly.offline"):
        monkeypatch.setitem(sys.modules, name, None)
    assert report(solved, "--output", tmp_path / "page.html") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "pip install 'vislam_ros[report]'" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["plot", "report", "view", "evaluate"])
def test_a_reference_of_another_drive_is_named(
    solved: Path,
    dataset: Path,
    tmp_path: Path,
    command: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    other = tmp_path / "other.tum"
    lines = dataset.with_suffix(".tum").read_text().splitlines()
    other.write_text("".join(f"2{line[1:]}\n" for line in lines))
    output = ["--save", str(tmp_path / "run.rrd")] if command == "view" else []
    assert main([command, str(solved), "--reference", str(other), *output]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {solved} against {other}: 0 poses of the reference lie within")


def test_pictures_are_drawn_as_asked(
    solved: Path, dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = dataset.with_suffix(".tum")
    argv = ["plot", solved, "--reference", reference, "--output", tmp_path, "--format", "svg"]
    assert main([*map(str, argv), "--align", "first"]) == 0
    drawn = {Path(line).name for line in capsys.readouterr().out.splitlines()}
    assert drawn == {"trajectory.svg", "steps.svg", "estimates.svg", "errors.svg"}
    assert "RMS error" in (tmp_path / "trajectory.svg").read_text()
