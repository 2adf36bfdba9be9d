# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""tools/constraints.py writes once what all Pythons share, and else for which a version is."""

import json
import sys
from pathlib import Path

import constraints
import pytest

from vislam_ros.errors import VislamError


def test_a_version_that_all_pythons_have_is_written_once() -> None:
    resolved = {(3, 10): {"a": "1.0"}, (3, 11): {"a": "1.0"}}
    assert list(constraints.pins(resolved)) == ["a==1.0"]


def test_versions_that_differ_name_their_pythons_without_a_gap() -> None:
    resolved = {
        (3, 12): {"b": "3", "a": "2"},
        (3, 9): {"a": "1"},
        (3, 10): {"a": "1"},
        (3, 11): {"a": "1.5"},
    }
    assert list(constraints.pins(resolved)) == [
        'a==1 ; python_version < "3.11"',
        'a==1.5 ; python_version >= "3.11" and python_version < "3.12"',
        'a==2 ; python_version >= "3.12"',
        "b==3",
    ]


def test_pip_is_asked_for_all_but_the_project_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    report = {
        "environment": {"python_version": "3.13"},
        "install": [
            {
                "metadata": {"name": "Some_Thing", "version": "1.0"},
                "download_info": {"url": "file:///project", "dir_info": {}},
            },
            {
                "metadata": {"name": "ruamel.yaml", "version": "0.19"},
                "download_info": {"url": "https://index/ruamel.yaml-0.19.whl"},
            },
        ],
    }
    monkeypatch.setattr(constraints, "_output", lambda *_: json.dumps(report))
    assert constraints.resolve("python3", ".") == ((3, 13), {"ruamel-yaml": "0.19"})


def test_an_interpreter_that_is_missing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert constraints.main([".", "no_such_python"]) == 1
    assert capsys.readouterr().err.startswith("error: no_such_python: No such file")


def test_what_pip_cannot_find_is_told(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="no_such_folder"):
        constraints.resolve(sys.executable, str(tmp_path / "no_such_folder"))
