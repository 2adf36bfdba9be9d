# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The README's commands run one after the other in an empty folder, as they stand there."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import REPOSITORY

from vislam_ros.data.trajectory import read_tum

# The drive in real time would take a minute.
SHORTER = ["--steps", "80", "--landmarks", "400"]


def commands() -> list[list[str]]:
    """Words of the commands of the section, in its order."""
    page = (REPOSITORY / "README.md").read_text()
    section = page.partition("## A drive, step by step\n")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```sh\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)
    return [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]


@pytest.mark.timeout(400)
def test_the_readmes_sequence_runs_from_top_to_bottom_in_an_empty_folder(tmp_path: Path) -> None:
    sequence = commands()
    assert [words[:2] for words in sequence[:2]] == [["vislam", "simulate"], ["vislam", "run"]]
    assert len(sequence) >= 9
    environment = {
        name: value for name, value in os.environ.items() if name not in ("ROS_DOMAIN_ID",)
    }
    said = {}
    for program, command, *words in sequence:
        assert program == "vislam"
        assert "--force" not in words
        ended = subprocess.run(
            [
                *(sys.executable, "-m", "vislam_ros.cli.main", command, *words),
                *(SHORTER if command == "simulate" else []),
            ],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert ended.returncode == 0, f"{command}: {ended.stderr}"
        said[command] = ended.stdout
    for estimate in ("filtered", "smoothed", "dead reckoning"):
        assert estimate in said["evaluate"]
    results = tmp_path / "results"
    live, offline = (results / name / "trajectory.tum" for name in ("live", "offline"))
    assert live.read_bytes() == offline.read_bytes()
    (exported,) = tmp_path.glob("*.csv")
    smoothed = np.loadtxt(exported, delimiter=",")
    assert len(smoothed) == len(read_tum(live))
