# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""No command destroys what it reads."""

import argparse
import shutil
from pathlib import Path

import pytest

from vislam_ros.cli.grammar.paths import OUTPUTS
from vislam_ros.cli.main import main
from vislam_ros.cli.parser import build_parser
from vislam_ros.data.bags.integrity import require_intact


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, dataset: Path) -> Path:
    path = tmp_path_factory.mktemp("solved") / "results"
    assert main(["solve", str(dataset), "--out", str(path)]) == 0
    return path


@pytest.fixture
def folder(
    tmp_path: Path, dataset: Path, bag: Path, results: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A folder with a drive as a dataset, a bag, images (so far as they matter) and results."""
    shutil.copy(dataset, tmp_path / "drive.npz")
    shutil.copy(dataset.with_suffix(".tum"), tmp_path / "drive.tum")
    shutil.copytree(bag, tmp_path / "bag")
    shutil.copytree(results, tmp_path / "results")
    (tmp_path / "images" / "image_0").mkdir(parents=True)
    (tmp_path / "images" / "image_0" / "000000.png").write_bytes(b"a picture")
    (tmp_path / "link").symlink_to(tmp_path / "bag")
    (tmp_path / "sweep.yaml").write_text("data: bag\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        "solve bag --out bag/results",
        "solve bag --out bag",
        "solve bag --out link/results",
        "solve images --motion bag --out results/../bag/results",
        "solve bag/bag_0.mcap --out bag/results",
        "solve drive.npz --out results --map results/landmarks.npz",
        "run bag --out bag/results",
        "run drive.npz --out results --map results/landmarks.npz",
        "sweep bag --out bag/sweep",
        "sweep --file sweep.yaml --out bag/sweep",
        "track images drive.npz --motion drive.npz",
        "track images tracks.npz --motion drive.npz --picture images/image_0/000000.png",
        "convert images/../drive.npz drive.npz",
        "convert images images/image_0/bag --motion drive.npz",
        "convert bag/inner.npz bag",
        "simulate drive.npz --along drive.tum",
        "simulate . --images --along drive.tum",
        "export results results/trajectory.tum --format euroc",
        "export drive.tum drive.tum --format euroc",
        "report results --output results/trajectory.tum",
        "report results --reference drive.tum --output drive.tum",
        "plot results --reference drive.tum --output drive.tum",
        "view results --save results/landmarks.npz",
        "view results --data bag --save bag/results.rrd",
    ],
)
def test_an_output_that_is_of_an_input_is_refused_in_one_line(
    words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = content(folder)
    assert main([*words.split(), "--force"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "this command reads" in lines[0]
    assert content(folder) == before


@pytest.mark.parametrize(
    "words",
    [
        "solve bag --out bag_results",
        "solve drive.npz --out .",
        "export results results/drive.csv --format euroc",
        "plot results --output results --reference drive.tum",
        "plot results --output results/pictures",
        "convert drive.npz other_bag",
    ],
)
def test_what_lies_beside_an_input_goes_on_to_be_written(words: str, folder: Path) -> None:
    before = content(folder)
    assert main([*words.split(), "--force"]) == 0
    require_intact(folder / "bag")
    assert content(folder).items() > before.items()


def test_each_command_that_replaces_an_output_has_one_that_is_known() -> None:
    commands = next(
        action.choices
        for action in build_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    for name, parser in commands.items():
        names = {action.dest for action in parser._actions}
        assert ("force" in names) == bool(names & set(OUTPUTS)), name
