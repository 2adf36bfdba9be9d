# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""JSON objects in files."""

import json
from pathlib import Path
from typing import Any, NoReturn

from vislam_ros.data.files.inputs import read_text
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.errors import VislamError


def read_json(path: Path, what: str) -> dict[str, Any]:
    """Read a JSON object.

    Raises
    ------
    VislamError
        Where the file cannot be read, is no JSON object, or holds NaN or an infinity.
    """
    text = read_text(path, what)
    try:
        content = json.loads(text, parse_constant=_refuse)
    except RecursionError as error:
        raise VislamError(f"{path}: not a JSON file: it is nested too deeply") from error
    except ValueError as error:
        raise VislamError(f"{path}: not a JSON file: {error}") from error
    if not isinstance(content, dict):
        raise VislamError(f"{path}: cannot read {what}: it must hold one JSON object")
    return content


def write_json(path: Path, content: Any, *, indent: int | None = 2) -> None:
    """Write JSON, whole or not at all.

    Raises
    ------
    OutputError
        Where the file cannot be written.
    """
    replace_file(path, (json.dumps(content, indent=indent) + "\n").encode("utf-8"))


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"it holds {constant}")
