# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the fuzzer begins with is read, and what it keeps is what ends other than it should."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from reliability.fuzzing.campaign import Campaign
from reliability.fuzzing.targets import Target, targets

from vislam_ros.errors import VislamError

NAMES = ("npz", "npy", "bag", "mcap", "yaml", "tum", "steps", "summary", "landmarks")


@pytest.mark.parametrize("name", NAMES)
def test_every_seed_is_read_also_when_it_was_mended(tmp_path: Path, name: str) -> None:
    (target,) = targets(tmp_path, (name,))
    for seed in target.seeds:
        for content in (seed, target.mend(seed)):
            (tmp_path / name / target.file).write_bytes(content)
            target.read(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("npz", lambda content: content.index(b"features.npy") + 200),
        ("mcap", lambda content: content.rindex(b"base_link") + 13),
    ],
)
def test_a_number_that_was_changed_is_read_once_its_file_is_mended(
    tmp_path: Path, name: str, place: Callable[[bytes], int]
) -> None:
    (target,) = targets(tmp_path, (name,))
    file = tmp_path / name / target.file
    changed = bytearray(target.seeds[0])
    changed[place(target.seeds[0])] ^= 1
    file.write_bytes(changed)
    with pytest.raises(VislamError, match="damaged"):
        target.read(tmp_path / name)
    mended = target.mend(bytes(changed))
    assert mended != target.seeds[0]
    file.write_bytes(mended)
    target.read(tmp_path / name)


def test_a_campaign_keeps_the_first_of_each_kind_and_goes_on_where_it_was(tmp_path: Path) -> None:
    def read(place: Path) -> int:
        content = (place / "file").read_bytes()
        if content == b"refused":
            raise VislamError("no file of ours")
        return int(content)

    target = Target("numbers", "file", read, (b"1",))
    finds = tmp_path / "finds"
    finds.mkdir()
    for _ in range(2):
        campaign = Campaign(target, tmp_path, finds)
        for content in (b"1", b"refused", b"x", b"y"):
            campaign.run(content)
        campaign.report()
    report = json.loads((finds / "numbers.json").read_bytes())
    assert (report["executions"], report["read"]) == (8, 2)
    (found,) = report["finds"].values()
    assert found["count"] == 4
    assert (finds / found["file"]).read_bytes() == b"x"
