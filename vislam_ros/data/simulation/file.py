# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive as a dataset file, with its truth inside and as a TUM file beside it."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.datasets.sparse_features import ABSENT
from vislam_ros.data.drive import Drive
from vislam_ros.data.files.whole_file import refuse_existing, replace_files
from vislam_ros.data.simulation.simulate import BASELINE, INTRINSICS, T_BODY_CAMERA
from vislam_ros.data.simulation.simulated_drive import SimulatedDrive
from vislam_ros.data.trajectory import tum_text
from vislam_ros.errors import VislamError

_CELLS_AT_A_TIME = 1 << 19


def write_simulated(path: Path, simulated: SimulatedDrive, *, force: bool = False) -> Path:
    """Write a dataset and, with the suffix ``.tum``, its true trajectory.

    Equal drives are equal files. The dense features are written in blocks of a few megabytes.

    Parameters
    ----------
    path : Path
        Ends in ``.npz``.
    simulated : SimulatedDrive
    force : bool
        Replace files that exist.

    Returns
    -------
    Path
        The TUM file.

    Raises
    ------
    VislamError
        Where the path has another suffix, or a file exists or cannot be written.
    """
    if path.suffix != ".npz":
        raise VislamError(f"{path}: a simulated dataset is an .npz file: end its name in .npz")
    truth_path = path.with_suffix(".tum")
    refuse_existing(path, force=force)
    refuse_existing(truth_path, force=force)

    drive = simulated.drive
    first_points = simulated.landmarks.generations == 0
    arrays = {
        "time_stamps": simulated.seconds[None],
        "linear_velocity": drive.twists[:, :3].T,
        "angular_velocity": drive.twists[:, 3:].T,
        "K": INTRINSICS,
        "b": np.array(BASELINE),
        "imu_T_cam": T_BODY_CAMERA,
        "ground_truth_T_world_body": simulated.T_world_body,
        "ground_truth_landmarks": simulated.landmarks.positions[first_points],
    }
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        _write_features(archive, drive)
        write_arrays(archive, arrays)
    truth = drive.ground_truth
    assert truth is not None
    replace_files({truth_path: tum_text(truth).encode("ascii"), path: content.getvalue()})
    return truth_path


def write_arrays(archive: zipfile.ZipFile, arrays: Mapping[str, NDArray[np.generic]]) -> None:
    """Write arrays as members of an ``.npz`` file, whose bytes depend on them alone."""
    for name, array in arrays.items():
        with archive.open(_member(name), "w") as file:
            np.lib.format.write_array(file, np.ascontiguousarray(array))


def _member(name: str) -> zipfile.ZipInfo:
    """Describe a member with a fixed date, so that the file depends on its arrays alone."""
    info = zipfile.ZipInfo(f"{name}.npy")
    info.compress_type = zipfile.ZIP_DEFLATED
    return info


def _write_features(archive: zipfile.ZipFile, drive: Drive) -> None:
    tracks = int(drive.ids.max(initial=0)) + 1
    steps = np.repeat(np.arange(drive.steps), np.diff(drive.offsets))
    order = np.lexsort((steps, drive.ids))
    ids, steps, pixels = drive.ids[order].astype(np.int64), steps[order], drive.pixels[order]
    per_block = max(_CELLS_AT_A_TIME // drive.steps, 1)
    header = {"descr": "<f8", "fortran_order": False, "shape": (4, tracks, drive.steps)}
    with archive.open(_member("features"), "w", force_zip64=True) as file:
        np.lib.format.write_array_header_1_0(file, header)
        for component in range(4):
            for first in range(0, tracks, per_block):
                last = min(first + per_block, tracks)
                rows = slice(*np.searchsorted(ids, [first, last]))
                block: NDArray[np.float64] = np.full((last - first, drive.steps), ABSENT)
                block[ids[rows] - first, steps[rows]] = pixels[rows, component]
                file.write(block.astype("<f8", copy=False).tobytes())
