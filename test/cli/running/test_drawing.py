# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures are drawn by a process of their own, and what cannot be drawn is a warning."""

import shutil
from contextlib import closing

import pytest

from vislam_ros.cli.main import main
from vislam_ros.cli.running import drawing
from vislam_ros.cli.running.drawing import Pictures


@pytest.fixture(scope="module")
def results(tmp_path_factory, dataset):
    directory = tmp_path_factory.mktemp("solved") / "results"
    assert main(["solve", str(dataset), "--out", str(directory)]) == 0
    return directory


def test_what_has_results_is_drawn_and_of_what_has_none_a_warning_says_so(
    results, tmp_path, capfd
):
    copy, nothing = tmp_path / "copy", tmp_path / "nothing"
    shutil.copytree(results, copy)
    with closing(Pictures(tmp_path, "drive")) as pictures:
        pictures.prepare([])
        pictures.begin([nothing, copy])
        pictures.finish()
    assert {path.stem for path in copy.glob("*.png")} == {"trajectory", "steps", "estimates"}
    (warning,) = capfd.readouterr().err.splitlines()
    assert warning.startswith(f"warning: no picture: {nothing}")


def test_where_nothing_was_begun_nothing_is_drawn_and_no_process_is_left(tmp_path, capfd):
    with closing(Pictures(tmp_path, "drive")) as pictures:
        pictures.prepare([])
        child = pictures._child
        pictures.finish()
    assert child is not None
    assert child.exit_code is not None
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("changes", [False, True])
def test_what_was_drawn_early_counts_only_where_nothing_has_come_since(
    results, tmp_path, changes, monkeypatch
):
    early, late = tmp_path / "early", tmp_path / "late"
    shutil.copytree(results, early)
    shutil.copytree(results, late)
    if changes:  # the last rows are not written yet
        for name in ("steps.csv", "trajectory.tum", "trajectory_covariance.csv"):
            rows = (early / name).read_bytes().splitlines(keepends=True)
            (early / name).write_bytes(b"".join(rows[:-9]))
    monkeypatch.setattr(drawing, "_early", {})
    drawing.prepare(["drive", str(early)])
    ((seen, files),) = drawing._early.values()
    assert set(files) == {"steps", "estimates"}
    assert drawing._look_the_same(seen, drawing._read(late, "drive")) == (not changes)
    drawing._early[late] = seen, dict.fromkeys(files, b"early")
    assert drawing._drawn(late, "drive")
    written = [(late / f"{name}.png").read_bytes() for name in ("steps", "estimates")]
    assert [file == b"early" for file in written] == [not changes] * 2
    assert (late / "trajectory.png").read_bytes().startswith(b"\x89PNG")
