# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters, trajectories and results that are nested, endless, absurd or of the wrong kind."""

import dataclasses
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vislam_ros.core.filters.registry import estimator_named, estimator_names

_HEAD = "slam_node:\n  ros__parameters:\n"


def parameters(folder: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile parameter files below a folder; yields what each is, and its path."""
    texts: dict[str, bytes] = {
        "lists nested 100000 deep": b"a: " + 100_000 * b"[",
        "mappings nested 3000 deep": b"".join(b" " * k + b"a:\n" for k in range(300)) * 3,
        "flow mappings nested": 5000 * b"{a: ",
        "alias of itself": b"slam_node: &a {ros__parameters: *a}\n",
        "aliases of aliases": b"a: &a [x, x]\n"
        + b"".join(b"b%d: &b%d [*b%d, *b%d]\n" % (k, k, k - 1, k - 1) for k in range(1, 60)),
        "megabytes": _HEAD.encode() + b"    a: 1\n" * 500_000,
        "no text": bytes(range(256)) * 4,
        "a NUL": _HEAD.encode() + b"    map_file: a\x00b\n",
        "an integer of digits": _HEAD.encode() + b"    seed: " + 9_000 * b"9" + b"\n",
        "a float of digits": _HEAD.encode() + b"    chi2_gate: 1e400\n",
        "empty": b"",
        "a map that is a FIFO's name": _HEAD.encode() + b"    map_file: /dev/zero\n",
    }
    for tag, value in (("timestamp", "x"), ("bool", "x"), ("binary", "x"), ("set", "[1]")):
        texts[f"a {tag} that is none"] = f"{_HEAD}    a: !!{tag} {value}\n".encode()
    for number, (name, text) in enumerate(texts.items()):
        yield f"YAML: {name}", _written(folder / f"params_{number}.yaml", text)
    for name in _numbers():
        text = f"{_HEAD}    {name}: 1.0e+200\n".encode()
        yield f"setting {name} of 1e200", _written(folder / f"setting_{name}.yaml", text)


def _numbers() -> list[str]:
    """Settings of any estimator that are numbers with a fraction."""
    fields = (f for each in estimator_names() for f in _fields(each))
    return sorted({field.name for field in fields if type(field.default) is float})


def _fields(name: str) -> "tuple[dataclasses.Field[Any], ...]":
    return dataclasses.fields(estimator_named(name).settings)


def trajectories(folder: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile TUM files below a folder; yields what each is, and its path."""
    texts = {
        "stamps of 1e18": b"1e18 0 0 0 0 0 0 1\n",
        "stamps of 400 digits": 400 * b"9" + b" 0 0 0 0 0 0 1\n",
        "infinite stamps": b"inf 0 0 0 0 0 0 1\n",
        "positions of 1e300": b"1 1e300 0 0 0 0 0 1\n2 -1e300 0 0 0 0 0 1\n",
        "quaternions of 1e300": b"1 0 0 0 1e300 1e300 0 1e300\n",
        "quaternions of 1e-300": b"1 0 0 0 0 0 0 1e-300\n",
        "one line of megabytes": b"1 " * (4 << 20),
        "no text": bytes(range(256)) * 100,
        "zeros": bytes(1 << 20),
        "empty": b"",
        "comments alone": b"# t x y z\n" * 1000,
    }
    for number, (name, text) in enumerate(texts.items()):
        yield f"TUM: {name}", _written(folder / f"reference_{number}.tum", text)


def results(folder: Path, whole: Path) -> Iterator[tuple[str, Path]]:
    """Write hostile result directories below a folder; yields what each is, and its path."""
    summary = json.loads((whole / "summary.json").read_bytes())
    nan, other = ({**summary, **change} for change in ({"steps": float("nan")}, {"drive": [1]}))
    infinite = b"stamp,xx\ninf,0\n"
    header = (whole / "steps.csv").read_bytes().splitlines(keepends=True)[0]
    columns = header.count(b",")
    changes: dict[str, tuple[str, bytes]] = {
        "summary of NaN": (
            "summary.json",
            json.dumps(nan).encode(),
        ),
        "summary nested 100000 deep": ("summary.json", b'{"a":' + 100_000 * b"["),
        "summary of other types": ("summary.json", json.dumps(other).encode()),
        "summary of megabytes": ("summary.json", b" " * (4 << 20) + b"{}"),
        "summary of digits": ("summary.json", b'{"steps": ' + 9000 * b"9" + b"}"),
        "steps with infinite stamps": ("steps.csv", header + b"inf" + columns * b",0" + b"\n"),
        "steps of other columns": ("steps.csv", infinite),
        "steps of one endless line": ("steps.csv", header + 8_000_000 * b"1,"),
        "trajectory of 1e300": ("trajectory.tum", b"1 1e300 0 0 0 0 0 1\n"),
        "covariances of others": ("trajectory_covariance.csv", infinite),
        "landmarks that are text": ("landmarks.npz", b"PK no archive"),
        "parameters nested": ("params.yaml", 10_000 * b"["),
    }
    for number, (name, (file, content)) in enumerate(changes.items()):
        copy = folder / f"results_{number}"
        shutil.copytree(whole, copy)
        _written(copy / file, content)
        yield f"results: {name}", copy


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
