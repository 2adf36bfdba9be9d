# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the commands of evo say, to compare with; it is run as a program and never imported."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


def evo_statistics(tmp_path: Path, command: str, *arguments: str | Path) -> dict[str, float]:
    """Statistics that an evo command saves, which are those it prints, with all their digits.

    Parameters
    ----------
    tmp_path : Path
        For what it writes; its settings, too.
    command : str
        ``evo_ape`` or ``evo_rpe``.
    arguments : str or Path
        Reference and estimate, TUM files, and options.
    """
    program = Path(sys.executable).parent / command
    if not program.is_file():
        pytest.skip(f"needs {command} to compare with: pip install evo")
    saved = tmp_path / "evo.zip"
    subprocess.run(
        [program, "tum", *arguments, "--no_warnings", "--save_results", saved],
        check=True,
        timeout=120,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    with zipfile.ZipFile(saved) as archive:
        statistics: dict[str, float] = json.loads(archive.read("stats.json"))
    saved.unlink()
    return statistics
