# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Damage of any byte of a bag is found and named."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from places import SHARED_CASES

from vislam_ros.data.bags.integrity import require_intact, verify_bag
from vislam_ros.errors import VislamError

FILES = ("bag.mcap", "metadata.yaml", "provenance.json", "SHA256SUMS")


def recorded_elsewhere(bag: Path) -> Path:
    """The bag without what only this package writes."""
    for name in ("SHA256SUMS", "provenance.json"):
        (bag / name).unlink()
    return bag


def test_a_bag_as_written_is_intact(bag: Path) -> None:
    report = require_intact(bag)
    assert report.intact
    assert report.notes == ()


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_sha256sum_reads_the_checksums(bag: Path) -> None:
    done = subprocess.run(
        ["sha256sum", "--strict", "-c", "SHA256SUMS"], cwd=bag, capture_output=True, check=False
    )
    assert done.returncode == 0
    assert done.stdout.count(b": OK\n") == 3


@pytest.mark.parametrize("name", FILES)
def test_a_flipped_byte_is_found_anywhere(bag: Path, name: str) -> None:
    file = bag / name
    whole = file.read_bytes()
    rng = np.random.default_rng(7)
    places = {0, 1, len(whole) // 2, len(whole) - 1, *rng.integers(0, len(whole), 60).tolist()}
    for place in sorted(places):
        for bit in (1, int(2 ** rng.integers(1, 8)), 255):
            damaged = bytearray(whole)
            damaged[place] ^= bit
            file.write_bytes(damaged)
            report = verify_bag(bag)
            assert not report.intact, f"byte {place} ^ {bit}"
            assert any(name in fault for fault in report.faults)
            assert not any("\n" in fault for fault in report.faults)
    file.write_bytes(whole)
    assert verify_bag(bag).intact


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_cut_off_bag_is_named_and_refused(bag: Path, share: float) -> None:
    file = bag / "bag.mcap"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    assert verify_bag(bag).faults == ("bag.mcap: does not match its checksum in SHA256SUMS",)
    with pytest.raises(VislamError, match=r"bag: damaged: bag\.mcap") as error:
        require_intact(bag)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(bag: Path, name: str) -> None:
    (bag / name).unlink()
    (fault,) = verify_bag(bag).faults
    assert fault.startswith(f"{name}: is missing")


def test_an_additional_file_is_named(bag: Path) -> None:
    (bag / "more").mkdir()
    (bag / "more" / "file").write_text("")
    assert verify_bag(bag).faults == ("more/file: is not listed in SHA256SUMS",)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.upper(),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text + "\n",
        lambda text: "# checksums\n" + text,
        lambda text: "".join(reversed(text.splitlines(keepends=True))),
        lambda text: text.replace("  ", " *"),
        lambda text: text + text,
        lambda text: text.rstrip("\n"),
        lambda _: "",
    ],
)
def test_checksums_must_be_as_written(bag: Path, change: Callable[..., Any]) -> None:
    file = bag / "SHA256SUMS"
    file.write_bytes(change(file.read_text()).encode())
    report = verify_bag(bag)
    assert not report.intact
    assert all("SHA256SUMS" in fault for fault in report.faults)


def test_all_faults_are_listed_and_the_error_counts_them(bag: Path) -> None:
    (bag / "bag.mcap").write_bytes(b"")
    (bag / "metadata.yaml").unlink()
    assert len(verify_bag(bag).faults) == 2
    with pytest.raises(VislamError, match=r"\(and 1 more\)"):
        require_intact(bag)


@pytest.mark.parametrize("bare", [False, True])
def test_a_bag_from_elsewhere_is_checked_by_its_structure(bag: Path, bare: bool) -> None:
    recorded_elsewhere(bag)
    path = bag / "bag.mcap" if bare else bag
    report = require_intact(path)
    assert report.intact
    assert report.notes[0].startswith("carries no checksums")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("bare", [False, True])
def test_a_cut_off_bag_from_elsewhere_is_refused(bag: Path, bare: bool, share: float) -> None:
    recorded_elsewhere(bag)
    file = bag / "bag.mcap"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(VislamError, match=r"bag\.mcap: truncated or damaged"):
        require_intact(file if bare else bag)


def test_a_bag_from_elsewhere_without_its_storage_file_is_refused(bag: Path) -> None:
    recorded_elsewhere(bag)
    (bag / "bag.mcap").unlink()
    with pytest.raises(VislamError, match="missing"):
        require_intact(bag)


def test_crcs_of_a_bag_from_elsewhere_are_checked(tmp_path: Path) -> None:
    file = tmp_path / "recorded.mcap"
    with file.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/text", "cdr", schema)
        writer.add_message(channel, 1, b"\x00\x01\x00\x00\x05\x00\x00\x00text\x00", 1)
        writer.finish()
    assert verify_bag(file).intact
    whole = file.read_bytes()
    file.write_bytes(whole.replace(b"text\x00", b"tent\x00"))
    (fault,) = verify_bag(file).faults
    assert "CRC" in fault
    file.write_bytes(whole + b"more")
    assert not verify_bag(file).intact


@pytest.mark.parametrize("kind", ["nothing", "folder", "file"])
def test_what_is_no_bag_is_said_in_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "thing"
    if kind == "folder":
        path.mkdir()
    elif kind == "file":
        path.write_text("hello")
    with pytest.raises(VislamError, match=r"thing: (no such file|is not a bag)"):
        verify_bag(path)


def test_topics_of_which_no_message_can_be_read_are_a_fault() -> None:
    path = SHARED_CASES / "hostile" / "uint31.mcap"
    if not path.exists():
        pytest.skip(f"needs {path}")
    (fault,) = verify_bag(path).faults
    topics = "/stereo/left/camera_info and /stereo/right/camera_info"
    assert fault.startswith(f"no usable message on {topics}: its bytes are")
