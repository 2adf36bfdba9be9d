# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hostile files of every kind, each with a command that is given it: what is tried."""

import os
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from reliability.hostile_arrays import archives, pickles
from reliability.hostile_bags import bags
from reliability.hostile_images import images
from reliability.hostile_texts import parameters, results, trajectories
from vislam_ros.cli.main import main as vislam
from vislam_ros.errors import VislamError

#: Stands for a folder that is made for a command and must be gone, or empty, when it ends.
OUT = "{out}"


@dataclass(frozen=True)
class Case:
    """A command that is given something hostile.

    Attributes
    ----------
    kind, name : str
        In the table, and of the input.
    arguments : tuple of str
        Of ``vislam``; what it may write is below :data:`OUT`.
    limits : dict of str to int
        Of the process, by their names in :mod:`resource`.
    stdout : str
        Where its standard output goes.
    """

    kind: str
    name: str
    arguments: tuple[str, ...]
    limits: dict[str, int] = field(default_factory=dict)
    stdout: str = os.devnull


def cases(folder: Path) -> list[Case]:
    """Write all hostile files below a folder, which is empty, and name their commands."""
    data, reference, bag, solved = (
        folder / name for name in ("seed.npz", "seed.tum", "seed_bag", "seed_results")
    )
    for arguments in (
        ("simulate", data, "--steps", "12", "--landmarks", "40"),
        ("convert", data, bag),
        ("solve", data, "--out", solved),
    ):
        if code := vislam([str(word) for word in arguments]):
            raise VislamError(f"vislam {arguments[0]} ended with {code}")
    return [
        *_of("archives", archives(folder, dict(np.load(data))), "solve", "{}", "--out", OUT),
        *_of("pickles", pickles(folder), "convert", "{}", OUT),
        *_of("bags", bags(folder, bag), "solve", "{}", "--out", OUT),
        *_of("images", images(folder), "track", "{}", f"{OUT}.npz"),
        *_of("parameters", parameters(folder), "solve", data, "--params", "{}", "--out", OUT),
        *_of("trajectories", trajectories(folder), "evaluate", solved, "--reference", "{}"),
        *_of("results", results(folder, solved), "plot", "{}", "--output", OUT),
        *special_files(folder, data, reference, bag, solved),
        *names(folder),
        *scarce(data, solved, reference),
    ]


def shared_cases(shared: Path, data: Path) -> list[Case]:
    """Commands for the hostile files that others found, in a folder that holds them."""
    found = {
        "solve {} --out {out}": ("huge_linear_velocity.npz", "pk_bytearray_2e10_many.npy"),
        "verify {}": ("uint31.mcap", "cov_stampinf", "sum_nan"),
        "solve {data} --params {} --out {out}": (
            "deepmap.yaml",
            "selfalias.yaml",
            "slip1e300.yaml",
        ),
        "simulate {out}/a.npz --along {}": ("e18.tum",),
        "plot {} --output {out}": ("cov_stampinf", "sum_nan"),
    }
    return [
        Case(
            "found by others",
            name,
            tuple(
                word.replace("{data}", str(data)).replace("{}", str(shared / name))
                for word in command.split()
            ),
        )
        for command, names_of in found.items()
        for name in names_of
        if (shared / name).exists()
    ]


def special_files(
    folder: Path, data: Path, reference: Path, bag: Path, solved: Path
) -> Iterator[Case]:
    """What is no regular file, in the place of each input."""
    fifo, device, directory, address = (
        folder / name for name in ("fifo", "device", "directory", "socket")
    )
    os.mkfifo(fifo)
    device.symlink_to("/dev/zero")
    directory.mkdir()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(address))
    for kind in (fifo, device, directory, address, folder / "missing"):
        in_bag = folder / f"bag_with_{kind.name}"
        in_bag.mkdir()
        (in_bag / "metadata.yaml").write_bytes((bag / "metadata.yaml").read_bytes())
        (in_bag / f"{bag.name}.mcap").symlink_to(kind)
        in_results = folder / f"results_with_{kind.name}"
        in_results.mkdir()
        for file in solved.iterdir():
            (in_results / file.name).symlink_to(kind if file.name == "steps.csv" else file)
        named = folder / f"{kind.name}.npz"
        named.symlink_to(kind)
        for place, words in {
            "dataset": ("solve", named, "--out", OUT),
            "bag": ("solve", in_bag, "--out", OUT),
            "parameters": ("solve", data, "--params", kind, "--out", OUT),
            "reference": ("evaluate", solved, "--reference", kind),
            "motion": ("simulate", f"{OUT}/a.npz", "--along", kind),
            "sweep": ("sweep", "--file", kind, "--out", OUT),
        }.items():
            yield Case("special files", f"{kind.name} as {place}", _words(words))
        if kind.name != "missing":  # results without steps are results
            yield Case(
                "special files",
                f"{kind.name} as steps",
                _words(("plot", in_results, "--output", OUT)),
            )


def names(folder: Path) -> Iterator[Case]:
    """Files whose names are no plain text."""
    for number, name in enumerate((b"a\nb.npz", b"\x1b[31mred.npz", b"\xff\xfe.npz", b"a\rb.npz")):
        path = folder / os.fsdecode(name)
        path.write_bytes(b"no archive")
        yield Case("names", f"name {number}", ("solve", str(path), "--out", OUT))
        yield Case("names", f"name {number} of a bag", ("verify", str(path)))


def scarce(data: Path, solved: Path, reference: Path) -> Iterator[Case]:
    """Commands that have little of something, or no place to write to."""
    evaluate = ("evaluate", str(solved), "--reference", str(reference), "--json")
    yield Case("scarcity", "full disk behind the output", evaluate, stdout="/dev/full")
    solve = ("solve", str(data), "--out", OUT)
    yield Case("scarcity", "6 file handles", solve, {"RLIMIT_NOFILE": 6})
    yield Case("scarcity", "files of at most 2 kB", solve, {"RLIMIT_FSIZE": 2048})
    plot = ("plot", str(solved), "--output", OUT)
    yield Case("scarcity", "pictures of at most 2 kB", plot, {"RLIMIT_FSIZE": 2048})
    simulate = ("simulate", f"{OUT}.npz", "--steps", "900", "--landmarks", "900000")
    yield Case("scarcity", "800 MB of memory", simulate, {"RLIMIT_AS": 800 << 20})
    for name, place in (("a device", "/dev/null"), ("no disk", "/proc/vislam/results")):
        yield Case("scarcity", f"output on {name}", ("solve", str(data), "--out", place))


def _of(kind: str, files: Iterator[tuple[str, Path]], *words: str | Path) -> Iterator[Case]:
    for name, path in files:
        yield Case(kind, name, tuple(str(word).replace("{}", str(path)) for word in words))


def _words(words: tuple[str | Path, ...]) -> tuple[str, ...]:
    return tuple(str(word) for word in words)
