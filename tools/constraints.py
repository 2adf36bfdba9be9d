#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Print a constraints file for pip: the newest versions that go together on each Python given.

tools/constraints.py '.[ros,test]' python3.10 python3.13 > constraints.txt
"""

import argparse
import itertools
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from vislam_ros.cli.exit_codes import FAILED, OK
from vislam_ros.errors import VislamError

#: Major and minor version.
Python = tuple[int, int]


def main(argv: list[str] | None = None) -> int:
    """Resolve, print and return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        resolved = dict(resolve(python, arguments.requirement) for python in arguments.pythons)
    except VislamError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    print(f"# Made by `make constraints` with Python {', '.join(map(_dotted, sorted(resolved)))}.")
    print("\n".join(pins(resolved)))
    return OK


def resolve(python: str, requirement: str) -> tuple[Python, dict[str, str]]:
    """Ask pip which versions it would install for a requirement, with all that this needs.

    Parameters
    ----------
    python : str
        Interpreter; it is asked in a virtual environment of its own.
    requirement : str
        As pip takes it, of a folder.

    Returns
    -------
    (int, int), dict of str to str
        The interpreter's version, and the version of each package.
    """
    with tempfile.TemporaryDirectory() as folder:
        _output(python, "-m", "venv", folder)
        report = json.loads(
            _output(
                *(Path(folder) / "bin" / "python", "-m", "pip", "install", "--quiet"),
                *("--dry-run", "--ignore-installed", "--use-pep517", "--report", "-", requirement),
            )
        )
    major, minor = report["environment"]["python_version"].split(".")
    return (int(major), int(minor)), {
        _normal(package["metadata"]["name"]): package["metadata"]["version"]
        for package in report["install"]
        if "dir_info" not in package["download_info"]
    }


def pins(resolved: Mapping[Python, Mapping[str, str]]) -> Iterator[str]:
    """Write a line for each version of each package, and for which Pythons it is."""
    for name in sorted(set().union(*resolved.values())):
        versions = [(of[name], python) for python, of in sorted(resolved.items()) if name in of]
        # The first Python of each run of Pythons that have the same version.
        runs = [next(run) for _, run in itertools.groupby(versions, key=lambda pair: pair[0])]
        beyond = [python for _, python in runs[1:]] + [None]
        for i, ((version, first), end) in enumerate(zip(runs, beyond, strict=True)):
            bounds = [f'python_version >= "{_dotted(first)}"'] if i else []
            bounds += [f'python_version < "{_dotted(end)}"'] if end else []
            yield f"{name}=={version}" + (f" ; {' and '.join(bounds)}" if bounds else "")


def _output(*command: str | Path) -> str:
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise VislamError(f"{command[0]}: {error.strerror}") from error
    if result.returncode:
        raise VislamError(f"{' '.join(map(str, command))}: {result.stderr.strip()}")
    return result.stdout


def _normal(name: str) -> str:
    """Spell a package's name as the index does: importlib_metadata is importlib-metadata."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _dotted(python: Python) -> str:
    return ".".join(map(str, python))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("requirement", help="what is to be installed, as pip takes it: '.[test]'")
    parser.add_argument("pythons", nargs="+", metavar="python", help="an interpreter")
    return parser


if __name__ == "__main__":
    sys.exit(main())
