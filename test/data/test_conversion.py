# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a dataset to a bag: the same drive, with its reference and its provenance."""

import json
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vislam_ros.data.bags.integrity import file_sha256, require_intact
from vislam_ros.data.bags.reader import read_passes
from vislam_ros.data.conversion import convert
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.drive import Drive
from vislam_ros.data.loading import load_drive
from vislam_ros.data.trajectory import Trajectory, read_tum, write_tum
from vislam_ros.errors import VislamError

STEPS = 30


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """A small file in the dataset's format."""
    rng = np.random.default_rng(4)
    features = rng.uniform(0, 300, (4, 12, STEPS))
    features[:, rng.random((12, STEPS)) < 0.4] = -1
    path = tmp_path / "short drive.npz"
    np.savez(
        path,
        features=features,
        time_stamps=1.3e9 + 0.1 * np.arange(STEPS)[None],
        linear_velocity=rng.normal(size=(3, STEPS)),
        angular_velocity=0.1 * rng.normal(size=(3, STEPS)),
        K=np.array([[700.0, 0, 150], [0, 700, 120], [0, 0, 1]]),
        b=0.5,
        imu_T_cam=np.array([[0.0, 0, 1, 1], [-1, 0, 0, 0], [0, -1, 0, 0.5], [0, 0, 0, 1]]),
    )
    return path


def same(one: Any, other: Any) -> bool:
    """Equal type for type and bit for bit."""
    if type(one) is not type(other):
        return False
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return bool(one == other)


AS_GIVEN = Conventions("as-given", "end", "body")


def load(path: Path) -> Drive:
    return load_drive(path, conventions=AS_GIVEN)


def test_a_dataset_and_its_bag_are_the_same_drive(dataset, tmp_path):
    shares: list[float] = []
    written = convert(
        dataset,
        tmp_path / "bag",
        conventions=AS_GIVEN,
        progress=shares.append,
    )
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    assert same(load(dataset), written)
    assert same(load(tmp_path / "bag"), written)
    provenance = json.loads((tmp_path / "bag" / "provenance.json").read_text())
    assert provenance["source"] == {"name": dataset.name, "sha256": file_sha256(dataset)}
    assert provenance["settings"] == {
        "imu_frame": "as-given",
        "twist_index": "end",
        "twist_origin": "body",
        "extrinsics": "auto",
    }


def test_a_reference_becomes_the_ground_truth_of_the_drives_time(dataset, tmp_path):
    stamps = load(dataset).feature_stamps
    start, period = int(stamps[0]), 100_000_000
    stamps = np.array([start - period, start, start + 3 * period, start + STEPS * period])
    quaternions = np.array([[0.0, 0, 0, 1], [0, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    reference = tmp_path / "reference.tum"
    write_tum(reference, Trajectory(stamps, np.eye(4, 3), quaternions))
    convert(dataset, tmp_path / "bag", reference=reference)
    truth = read_passes(tmp_path / "bag")[0].ground_truth
    assert truth is not None
    assert truth.stamps.tolist() == stamps[1:3].tolist()
    assert truth.positions.tolist() == np.eye(4, 3)[1:3].tolist()
    assert truth.quaternions.tolist() == [[0, 0, 0, 1], [0, 0, 1, 0]]
    settings = json.loads((tmp_path / "bag" / "provenance.json").read_text())["settings"]
    assert settings["reference"] == {
        "name": "reference.tum",
        "sha256": file_sha256(reference),
    }


def test_a_reference_of_another_drive_is_refused(dataset, tmp_path):
    reference = tmp_path / "other.tum"
    reference.write_text("5.0 0 0 0 0 0 0 1\n")
    with pytest.raises(VislamError, match=r"other\.tum: has no pose in the time of short drive"):
        convert(dataset, tmp_path / "bag", reference=reference)
    assert not (tmp_path / "bag").exists()


def test_an_existing_output_is_refused_before_the_dataset_is_read(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(VislamError, match="bag: exists already"):
        convert(tmp_path / "nothing.npz", tmp_path / "bag")


def test_a_damaged_bag_is_not_loaded(dataset, tmp_path):
    bag = tmp_path / "bag"
    convert(dataset, bag)
    file = bag / "bag.mcap"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(VislamError, match="bag: damaged: "):
        load_drive(bag)


def test_what_is_neither_dataset_nor_bag_is_refused(tmp_path):
    with pytest.raises(VislamError, match="no such file"):
        load_drive(tmp_path / "nothing")
    with pytest.raises(VislamError, match="neither a dataset"):
        load_drive(tmp_path)


def test_a_real_drive_and_its_bag_are_the_same(shared_data, tmp_path):
    data, reference = shared_data / "0020.npz", shared_data / "ground_truth" / "0020.tum"
    written = convert(data, tmp_path / "0020", reference=reference)
    require_intact(tmp_path / "0020")
    read = read_passes(tmp_path / "0020")[0]
    # What was repaired stands in the bag's notes alone: the bag has it no more.
    assert [each.note for each in written.findings] == [*read.notes]
    assert same(read, replace(written, findings=()))
    assert same(read.camera, load_drive(data).camera)
    assert read.ground_truth is not None
    assert read.ground_truth.positions.tolist() == read_tum(reference).positions.tolist()
