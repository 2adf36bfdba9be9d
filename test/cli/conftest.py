# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A small drive as a dataset and as a bag, made by the commands themselves."""

from pathlib import Path

import pytest
from live.running import WAIT, Run

from vislam_ros.cli.main import main

STEPS = 60


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dataset") / "small.npz"
    assert main(["simulate", str(path), "--steps", str(STEPS), "--landmarks", "250"]) == 0
    return path


@pytest.fixture(scope="session")
def bag(tmp_path_factory: pytest.TempPathFactory, dataset: Path) -> Path:
    path = tmp_path_factory.mktemp("bag") / "small_bag"
    assert main(["convert", str(dataset), str(path)]) == 0
    return path


@pytest.fixture
def start(tmp_path):
    """Start a run; it is gone after the test."""
    runs = []

    def start(data, *flags, name="run", **options):
        run = Run(data, tmp_path / name, *flags, **options)
        runs.append(run)
        return run

    yield start
    for run in runs:
        run.process.kill()
        run.process.communicate(timeout=WAIT)
