# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The file of figures that a measurement writes."""

import argparse
from pathlib import Path
from typing import Any

from vislam_ros.data.files.json_file import write_json


def add_output(parser: argparse.ArgumentParser, default: Path, beside: str = "") -> None:
    """Add ``--out`` and ``--force``."""
    text = f"{beside} ({default})".strip()
    parser.add_argument("--out", type=Path, default=default, metavar="FILE", help=text)
    parser.add_argument("--force", action="store_true", help="replace FILE")


def write_output(file: Path, content: Any, *, indent: int | None = 1) -> None:
    """Write figures as JSON, in a folder that may be missing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_json(file, content, indent=indent)
