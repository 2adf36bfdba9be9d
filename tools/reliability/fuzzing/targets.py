# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is fuzzed: each kind of file with its reader, files to begin with, and how to mend one."""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reliability.fuzzing.repairs import mended_archive, mended_mcap, plain_mcap
from vislam_ros.core.filters.flat_settings import setting_owners, slam_settings
from vislam_ros.data.bags.bag_messages import BagMessages
from vislam_ros.data.bags.writer import write_bag
from vislam_ros.data.evaluation.evaluate import evaluate_results
from vislam_ros.data.files.parameter_file import node_parameters, read_parameters
from vislam_ros.data.loading import load_passes
from vislam_ros.data.results.reader import read_results
from vislam_ros.data.results.summary import peak_rss_mb
from vislam_ros.data.results.writer import ResultWriter
from vislam_ros.data.simulation.file import write_simulated
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError

Mending = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Target:
    """A kind of file.

    Attributes
    ----------
    name : str
    file : str
        Where its bytes go, below a folder of its own.
    read : callable
        Is given that folder; a VislamError is the right answer to most bytes.
    seeds : tuple of bytes
        Right files to begin with.
    mend : callable
        Puts checksums and lengths right, so that what was changed is read.
    """

    name: str
    file: str
    read: Callable[[Path], object]
    seeds: tuple[bytes, ...]
    mend: Mending = bytes


def targets(folder: Path, names: tuple[str, ...]) -> list[Target]:
    """Prepare the targets of some names; a folder for each is made below ``folder``."""
    makers = {
        "npz": _npz,
        "npy": _npy,
        "bag": _bag,
        "mcap": _mcap,
        "yaml": _yaml,
        "tum": _tum,
        "steps": _steps,
        "summary": _summary,
        "landmarks": _landmarks,
    }
    if unknown := sorted(set(names) - makers.keys()):
        raise VislamError(f"{', '.join(unknown)}: no such target; there are {', '.join(makers)}")
    made = []
    for name in names or makers:
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        made.append(makers[name](place))
    return made


def _drive(folder: Path) -> Path:
    """Path of a drive of a few steps."""
    path = folder / "seed.npz"
    simulated = simulate(SimulationSettings(steps=4, landmarks=8, seed=1))
    write_simulated(path, simulated, force=True)
    return path


def _npz(folder: Path) -> Target:
    path = _drive(folder)
    return Target(
        "npz",
        "drive.npz",
        lambda place: load_passes(place / "drive.npz"),
        (mended_archive(path.read_bytes()),),
        mended_archive,
    )


def _npy(folder: Path) -> Target:
    arrays = dict(np.load(_drive(folder)))
    seeds = []
    for values in (arrays, {name: array.tolist() for name, array in arrays.items()}):
        content = io.BytesIO()
        np.save(content, np.array(values, dtype=object))
        seeds.append(content.getvalue())
    return Target("npy", "drive.npy", lambda place: load_passes(place / "drive.npy"), tuple(seeds))


def _bag_seed(folder: Path) -> bytes:
    drive = load_passes(_drive(folder))[0]
    write_bag(drive, folder / "seed_bag", force=True)
    return next((folder / "seed_bag").glob("*.mcap")).read_bytes()


def _bag(folder: Path) -> Target:
    """A bag directory, whose metadata are what changes."""
    _bag_seed(folder)
    bag = folder / "bag"
    shutil.rmtree(bag, ignore_errors=True)
    shutil.copytree(folder / "seed_bag", bag)
    for name in ("SHA256SUMS", "provenance.json"):
        (bag / name).unlink()

    def read(place: Path) -> object:
        with BagMessages(place / "bag") as messages:
            return messages.connections, messages.start, messages.end

    return Target("bag", "bag/metadata.yaml", read, ((bag / "metadata.yaml").read_bytes(),))


def _mcap(folder: Path) -> Target:
    seed = plain_mcap(_bag_seed(folder))
    return Target(
        "mcap", "bag.mcap", lambda place: load_passes(place / "bag.mcap"), (seed,), mended_mcap
    )


def _yaml(_folder: Path) -> Target:
    def read(place: Path) -> object:
        values = node_parameters(read_parameters(place / "params.yaml"), "slam_node")
        known = setting_owners(values)
        return slam_settings({name: value for name, value in values.items() if name in known})

    seeds = (
        b"slam_node:\n  ros__parameters:\n    estimator: joint\n    chi2_gate: 16.27\n"
        b"    pixel_variance: [1.0, 1e3, 2.0, 1.0]\n    track_continuity: true\n    seed: 0x10\n",
        b"/**: {ros__parameters: {seed: 3, a: {b: !!str x}}}\n/robot:\n  slam_node:\n"
        b'    ros__parameters: {map_file: "a", time_jump: .5}\n',
    )
    return Target("yaml", "params.yaml", read, seeds)


def _tum(_folder: Path) -> Target:
    seeds = (
        b"1.5 0 0 0 0 0 0 1\n2.500000001 1e-3 -2 3.5 0.1 0 0 0.9\n",
        b"# t x y z\n\n1700000000.1 1 2 3 0 0 0 1\r\n",
        b"#timestamp [ns],x\n1403636580838555648,1,2,3,1,0,0,0,9\n1.5e18, 1,2,3, .5,0,0,1e-3\n",
        b"1700000000000000000 1 2 3 0 0 0 1\n1700000000000000001.0 1 2 3 0 0 0 1\n",
    )
    return Target("tum", "ref.tum", lambda place: read_trajectory(place / "ref.tum"), seeds)


def _results(folder: Path) -> Path:
    """Results of a drive of a few steps, in a folder that is read as a whole."""
    results = folder / "results"
    drive = load_passes(_drive(folder))[0]
    with ResultWriter(results, force=True) as writer:
        solution = solve(
            drive,
            on_step=lambda s: writer.add_step(s.position, s.quaternion, s.covariance, s.row()),
        )
        writer.set_parameters({"slam_node": {"estimator": "robocentric"}})
        writer.set_landmarks(solution.landmarks)
        writer.finish(complete=True)
    shutil.copyfile(results / "trajectory.tum", folder / "reference.tum")
    return results


def _steps(folder: Path) -> Target:
    results = _results(folder)

    def read(place: Path) -> object:
        return read_results(place / "results")

    for name in ("landmarks.npz", "params.yaml", "trajectory_covariance.csv"):
        (results / name).unlink()
    lines = (results / "steps.csv").read_bytes().splitlines(keepends=True)
    return Target("steps", "results/steps.csv", read, (b"".join(lines[:3]),))


def _summary(folder: Path) -> Target:
    results = _results(folder)

    def read(place: Path) -> object:
        return evaluate_results(place / "results", place / "reference.tum")

    # Values that change from run to run would change what is found.
    summary = json.loads((results / "summary.json").read_bytes())
    summary.update(dict.fromkeys(("wall_s", "total_s", "peak_rss_mb"), peak_rss_mb() and 1.0))
    return Target("summary", "results/summary.json", read, (json.dumps(summary).encode(),))


def _landmarks(folder: Path) -> Target:
    results = _results(folder)
    with zipfile.ZipFile(results / "landmarks.npz") as archive:
        assert archive.namelist()
    seed = mended_archive((results / "landmarks.npz").read_bytes())
    with suppress(FileNotFoundError):
        (results / "steps.csv").unlink()
    return Target(
        "landmarks",
        "results/landmarks.npz",
        lambda place: read_results(place / "results"),
        (seed,),
        mended_archive,
    )
