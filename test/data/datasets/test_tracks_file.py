# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A file of tracks gives back the very drive, and a bad one is named."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rewriting import assert_same

from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.datasets import tracks_file
from vislam_ros.data.datasets.formats import read_dataset
from vislam_ros.data.datasets.tracks_file import matches, write_tracks
from vislam_ros.data.drive import Drive
from vislam_ros.errors import VislamError


@pytest.fixture
def tracked(small_drive: Drive) -> Drive:
    """With noise, and an IMU that is faster than the frames and tells no velocity."""
    rng = np.random.default_rng(2)
    first, last = small_drive.feature_stamps[[0, -1]]
    stamps = np.arange(first, last, 5_000_000)
    twists = rng.normal(size=(len(stamps), 6))
    twists[:, :3] = np.nan
    return dataclasses.replace(
        small_drive,
        twist_stamps=stamps,
        twists=twists,
        noise=rng.uniform(0.05, 2.0, len(small_drive.ids)).astype(np.float32),
    )


def test_a_drive_comes_back_bit_for_bit(tracked: Drive, tmp_path: Path) -> None:
    path = tmp_path / "tracks.npz"
    write_tracks(path, tracked)
    assert matches(path)
    assert_same(read_dataset(path), tracked)


def test_so_does_one_without_noise_truth_and_notes(small_drive: Drive, tmp_path: Path) -> None:
    bare = dataclasses.replace(small_drive, ground_truth=None, notes=())
    write_tracks(tmp_path / "tracks.npz", bare)
    assert_same(read_dataset(tmp_path / "tracks.npz"), bare)


def test_equal_drives_are_equal_files(tracked: Drive, tmp_path: Path) -> None:
    for name in ("one.npz", "two.npz"):
        write_tracks(tmp_path / name, tracked)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_noise_goes_through_a_bag(small_drive: Drive, tmp_path: Path) -> None:
    noise = np.linspace(0.1, 0.9, len(small_drive.ids)).astype(np.float32)
    noisy = dataclasses.replace(small_drive, noise=noise)
    write_bag(noisy, tmp_path / "bag")
    (back,) = read_passes(tmp_path / "bag")
    assert_same(back, noisy)


def test_other_files_do_not_match(tmp_path: Path) -> None:
    np.savez(tmp_path / "dense.npz", features=np.zeros(3))
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 and no more")
    for name in ("dense.npz", "broken.npz", "missing.npz"):
        assert not matches(tmp_path / name)


def test_outputs_are_not_overwritten_and_end_in_npz(tracked: Drive, tmp_path: Path) -> None:
    path = tmp_path / "tracks.npz"
    path.write_text("mine")
    with pytest.raises(VislamError, match="exists already"):
        write_tracks(path, tracked)
    assert path.read_text() == "mine"
    write_tracks(path, tracked, force=True)
    assert matches(path)
    with pytest.raises(VislamError, match=r"tracks are an \.npz file: end its name in \.npz"):
        write_tracks(tmp_path / "tracks.bag", tracked)


def with_values(name: str, *places: Any, value: Any) -> Any:
    def change(arrays: dict[str, Any]) -> None:
        arrays[name][places] = value

    return change


def without(name: str) -> Any:
    return lambda arrays: arrays.pop(name)


FAULTS = {
    "a later version": (with_values("vislam_tracks", value=2), "is of version 2 of this format"),
    "no ids": (without("ids"), "has no ids: track the images anew"),
    "ids of another type": (
        lambda arrays: arrays.update(ids=arrays["ids"].astype(np.int64)),
        r"ids is int64 of shape \(\d+,\), not uint32",
    ),
    "pixels of another shape": (
        lambda arrays: arrays.update(pixels=arrays["pixels"][:, :3]),
        r"pixels is float32 of shape \(\d+, 3\)",
    ),
    "a pixel that is none": (with_values("pixels", 5, 2, value=np.nan), "pixels: a pixel of nan"),
    "ids that fall": (with_values("ids", 1, value=0), r"ids\[1\] is not larger"),
    "offsets that fall": (with_values("offsets", 2, value=0), "offsets do not go from 0"),
    "no noise at all": (with_values("noise", 3, value=0.0), "noise is not finite and above 0"),
    "a stamp too early": (with_values("stamps", 4, value=7), "stamps are none, negative, or do"),
    "half a velocity": (with_values("twists", 0, 0, value=1.0), "twists: a velocity of nan"),
    "no turn": (with_values("twists", 0, 4, value=np.inf), "twists: an angular velocity of inf"),
    "no rotation": (with_values("camera", 8, value=3.0), "its quaternion is"),
    "no baseline": (with_values("camera", 4, value=0.0), "camera: a baseline of 0"),
    "a truth that is none": (
        with_values("truth_quaternions", 0, value=0.0),
        "truth_quaternions are not of length 1",
    ),
    "no text": (with_values("name", 0, value=255), "name is no text"),
}


@pytest.mark.parametrize(("fault", "reason"), FAULTS.values(), ids=FAULTS)
def test_faults_are_named(fault: Any, reason: str, tracked: Drive, tmp_path: Path) -> None:
    path = tmp_path / "tracks.npz"
    twice = np.flatnonzero(np.diff(tracked.offsets) > 1)
    assert twice[0] == 0
    write_tracks(path, tracked)
    arrays: Any = {name: np.array(values) for name, values in np.load(path).items()}
    fault(arrays)
    np.savez(path, **arrays)
    with pytest.raises(VislamError, match=reason) as caught:
        tracks_file.read(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
