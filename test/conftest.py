# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the whole suite."""

import os
import signal
from pathlib import Path

import hypothesis
import pytest
from places import SHARED_DATA, SHARED_IMAGES

# Threads of BLAS and of pytest-xdist would fight for the cores. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell gives what it starts in the background a SIGINT that is ignored, and so to the commands
# that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, and no limit of time that a busy machine could break.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real drives, which are too large and not free enough to be in the project."""
    if not (SHARED_DATA / "0020.npz").is_file():
        pytest.skip(
            f"needs the real drives, which are not in {SHARED_DATA}: set VISLAM_SHARED_DATA"
        )
    return SHARED_DATA


@pytest.fixture(scope="session")
def shared_images() -> Path:
    """Folder of real stereo images."""
    if not (SHARED_IMAGES / "kitti_0020" / "calib.txt").is_file():
        pytest.skip(f"needs the real images, which are not in {SHARED_IMAGES}")
    return SHARED_IMAGES
