# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the whole suite."""

import os
from pathlib import Path

import hypothesis
import pytest

# Threads of BLAS and of pytest-xdist would fight for the cores. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The same examples in every run, and no limit of time that a busy machine could break.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real drives, which are too large and not free enough to be in the project."""
    named = os.environ.get("VISLAM_SHARED_DATA")
    folder = Path(named) if named else REPOSITORY.parent / "shared" / "data"
    if not (folder / "0020.npz").is_file():
        pytest.skip(f"needs the real drives, which are not in {folder}: set VISLAM_SHARED_DATA")
    return folder
