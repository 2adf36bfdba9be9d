# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The offline estimate that a live one must equal, to the byte."""

import os
import subprocess
import sys
from pathlib import Path

from vislam_ros.errors import VislamError


def offline_trajectory(data: Path, out: Path) -> bytes:
    """``trajectory.tum`` of ``vislam solve``.

    Raises
    ------
    VislamError
        Where it fails, with what it said last.
    """
    command = ["solve", str(data), "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "vislam_ros.cli.main", *command],
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise VislamError(f"{data}: {(done.stderr.splitlines() or ['solve failed'])[-1]}")
    return (out / "trajectory.tum").read_bytes()
