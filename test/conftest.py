# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the whole suite."""

import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, where there is one."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("needs Chromium on the PATH: apt install chromium")
    flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as started:
        running = started.chromium.launch(executable_path=chromium, args=flags, timeout=120_000)
        yield running
        running.close()
