# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The small drive as a bag."""

from pathlib import Path

import pytest

from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.drive import Drive


@pytest.fixture
def bag(small_drive: Drive, tmp_path: Path) -> Path:
    write_bag(small_drive, tmp_path / "bag")
    return tmp_path / "bag"
