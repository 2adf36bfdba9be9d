# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A format from outside the package is read like those of its own, and a bad one is named."""

import dataclasses
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from vislam_ros.data.datasets import formats, npz
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import (
    format_of,
    import_format,
    read_dataset,
    register_dataset,
)
from vislam_ros.data.drive import Drive
from vislam_ros.data.loading import load_drive
from vislam_ros.data.simulation.simulate import simulate
from vislam_ros.errors import VislamError

DRIVE = simulate(steps=5, landmarks=20).drive


@pytest.fixture(autouse=True)
def forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers goes with it."""
    monkeypatch.setattr(formats, "_formats", list(formats._formats))


def is_toml(path: Path) -> bool:
    return path.suffix == ".toml"


def reader(read: Any) -> SimpleNamespace:
    return SimpleNamespace(matches=is_toml, read=read, __name__="toml_tracks")


def test_the_package_s_own_format_is_one_of_them(tmp_path: Path) -> None:
    (tmp_path / "drive.npz").touch()
    assert format_of(tmp_path / "drive.npz") is npz
    assert format_of(tmp_path / "nothing.npz") is None
    assert format_of(tmp_path) is None


def test_a_registered_format_is_read_by_load_drive(tmp_path: Path) -> None:
    def read(path: Path) -> Drive:
        return dataclasses.replace(DRIVE, name=path.stem)

    path = tmp_path / "mine.toml"
    with pytest.raises(VislamError, match="neither a dataset"):
        load_drive(tmp_path)
    register_dataset(reader(read))
    assert load_drive(str(path)).name == "mine"


def test_the_format_registered_last_is_asked_first(tmp_path: Path) -> None:
    register_dataset(reader(lambda path: dataclasses.replace(DRIVE, name="old")))
    register_dataset(reader(lambda path: dataclasses.replace(DRIVE, name="new")))
    assert load_drive(tmp_path / "mine.toml").name == "new"


def test_a_format_that_asks_for_them_hears_of_conventions_and_progress(tmp_path: Path) -> None:
    heard: list[Any] = []

    def read(path: Path, *, conventions: Conventions, progress: Any = None) -> Drive:
        heard.append(conventions)
        progress(1.0)
        return DRIVE

    register_dataset(reader(read))
    told = Conventions("flu", "end", "body")
    read_dataset(tmp_path / "mine.toml", conventions=told, progress=heard.append)
    assert heard == [told, 1.0]
    assert told != AS_FOUND


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (lambda path: 3, "mine.toml: toml_tracks read 3, which is no Drive"),
        (lambda path: 1 / 0, "mine.toml: cannot be read as toml_tracks: ZeroDivisionError"),
    ],
)
def test_a_format_that_fails_is_named_in_a_line(read: Any, message: str) -> None:
    register_dataset(reader(read))
    with pytest.raises(VislamError, match=message) as caught:
        load_drive("mine.toml")
    assert "\n" not in str(caught.value)


def test_what_is_no_format_is_refused() -> None:
    with pytest.raises(VislamError, match=r"half: a format has matches\(path\) and read\(path\)"):
        register_dataset(SimpleNamespace(matches=is_toml, __name__="half"))


def test_a_file_in_the_current_folder_is_imported_as_a_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "toml_format.py").write_text(
        "def matches(path):\n    return path.suffix == '.toml'\n\n"
        "def read(path):\n    raise NotImplementedError('not yet')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    import_format("toml_format")
    module = sys.modules.pop("toml_format")
    assert isinstance(module, ModuleType)
    assert format_of(Path("mine.toml")) is module
    with pytest.raises(VislamError, match="NotImplementedError: not yet"):
        load_drive("mine.toml")
    with pytest.raises(VislamError, match="no_such_format cannot be imported"):
        import_format("no_such_format")
