# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a result directory as files."""

import io
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Literal, TypeAlias

import matplotlib
from matplotlib.figure import Figure

from vislam_ros.data.evaluation.laid_paths import Laying
from vislam_ros.data.files.inputs import open_input
from vislam_ros.data.files.whole_file import made_directory, refuse_existing, replace_files
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.errors import draw_errors
from vislam_ros.data.pictures.estimates import draw_estimates
from vislam_ros.data.pictures.overview import draw_trajectory
from vislam_ros.data.pictures.steps import draw_steps
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

PictureFormat: TypeAlias = Literal["png", "svg"]

# A text of PNG that tells a picture which nobody asked for from one that somebody did.
_MARK, _OF_RUN = "Source", "vislam run"
_HEAD = 1024  # bytes of a picture, in which its texts stand


def plot_results(
    results: Results,
    reference: Trajectory | None = None,
    *,
    output: Path | None = None,
    force: bool = False,
    laying: Laying = "se3",
    picture_format: PictureFormat = "png",
    of_run: bool = False,
    drawn: Mapping[str, bytes] | None = None,
) -> list[Path]:
    """Write the pictures ``trajectory``, ``steps``, ``estimates`` and ``errors``.

    Those of which nothing is known are left out: ``steps`` and ``estimates`` where no steps were
    recorded, ``errors`` without a reference.

    Parameters
    ----------
    results : Results
    reference : Trajectory, optional
    output : Path, optional
        Folder for the pictures; the result directory by default.
    force : bool
        Replace pictures that exist. Those that a run drew at its end are replaced anyway.
    laying : str
        How ``trajectory`` lays the paths onto the reference; see
        :func:`vislam_ros.data.evaluation.laid_paths.laid_paths`.
    picture_format : str
        ``png`` or ``svg``.
    of_run : bool
        Whether a run draws them at its end.
    drawn : mapping of str to bytes, optional
        Pictures by name that need not be drawn again, see :func:`series_files`.

    Returns
    -------
    list of Path
        The pictures.

    Raises
    ------
    VislamError
        Where a picture exists and ``force`` is not given, or the reference is of another drive.
    """
    folder = results.directory if output is None else output
    draws: dict[str, Callable[[], Figure | None]] = {
        "trajectory": partial(draw_trajectory, results, reference, laying)
    }
    draws |= _series(results)
    if reference is not None:
        draws["errors"] = partial(draw_errors, results, reference)
    paths = {name: folder / f"{name}.{picture_format}" for name in draws}
    for path in paths.values():
        refuse_existing(path, force=force or _is_of_run(path))
    done = drawn or {}
    missing = {name: draw for name, draw in draws.items() if name not in done}
    files = {**done, **_files_of(missing, picture_format, of_run=of_run)}
    contents = {paths[name]: files[name] for name in draws if name in files}
    try:
        with made_directory(folder):
            replace_files(contents)
    except OSError as error:
        raise VislamError(f"{folder}: cannot hold pictures: {error.strerror}") from error
    return list(contents)


def series_files(results: Results, *, of_run: bool = False) -> dict[str, bytes]:
    """Draw ``steps`` and ``estimates``, which need no map, as PNG files by name."""
    return _files_of(_series(results), "png", of_run=of_run)


def _series(results: Results) -> dict[str, Callable[[], Figure | None]]:
    if not len(results.steps["stamp"]):
        return {}
    return {
        "steps": partial(draw_steps, results),
        "estimates": partial(draw_estimates, results),
    }


def _files_of(
    draws: Mapping[str, Callable[[], Figure | None]],
    picture_format: PictureFormat,
    *,
    of_run: bool,
) -> dict[str, bytes]:
    figures = ((name, draw()) for name, draw in draws.items())
    return {
        name: _file_of(figure, picture_format, of_run=of_run)
        for name, figure in figures
        if figure is not None
    }


def _is_of_run(picture: Path) -> bool:
    """Whether a run drew this picture at its end."""
    if not picture.is_file():
        return False
    with open_input(picture, "this picture") as file:
        head = file.read(_HEAD)
    return f"tEXt{_MARK}\0{_OF_RUN}".encode() in head


def _file_of(figure: Figure, picture_format: PictureFormat, *, of_run: bool) -> bytes:
    buffer = io.BytesIO()
    # The same results are the same file: no date, and no random names inside.
    metadata: dict[str, str | None] = {"Date": None} if picture_format == "svg" else {}
    if of_run:
        metadata[_MARK] = _OF_RUN
    with matplotlib.rc_context({"svg.hashsalt": "vislam"}):
        figure.savefig(buffer, dpi=palette.DOTS_PER_INCH, format=picture_format, metadata=metadata)
    return buffer.getvalue()
