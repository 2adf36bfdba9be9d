# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures are drawn by a process of their own, and what cannot be drawn is a warning."""

import shutil
from contextlib import closing

import pytest

from vislam_ros.cli.main import main
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
        pictures.prepare()
        pictures.begin([nothing, copy])
        pictures.finish()
    assert {path.stem for path in copy.glob("*.png")} == {"trajectory", "steps", "estimates"}
    (warning,) = capfd.readouterr().err.splitlines()
    assert warning.startswith(f"warning: no picture: {nothing}")


def test_where_nothing_was_begun_nothing_is_drawn_and_no_process_is_left(tmp_path, capfd):
    with closing(Pictures(tmp_path, "drive")) as pictures:
        pictures.prepare()
        child = pictures._child
        pictures.finish()
    assert child is not None
    assert child.exit_code is not None
    assert capfd.readouterr().err == ""
