# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a drive's NEES is the filter's or luck: the same drive, with its noise drawn anew.

A drive is one draw of its noise, and the error of a filter wanders slowly, so a drive has but a
few independent values of it. The reference gives the true twists and, of each track, the true
point. With new white noise on them, as large as the drive's own, NEES and ATE show their spread
(the parametric bootstrap: Efron and Tibshirani, *An Introduction to the Bootstrap*, 1993, chapter
6). All else stays as it is: the motion, which track is seen when, where its point is, the frozen
steps, and the tracks that fit no point.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation

from benchmark.consistency.simulated_drives import judged, std_error
from benchmark.consistency.track_points import fitted_point, moved_points
from benchmark.recorded_drive import twist_errors
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import pixels_of
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.core.tracking.tracks import Tracks
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.association import associate_stamps
from vislam_ros.data.solving import Solution, solve
from vislam_ros.data.trajectory import Trajectory, moving_steps
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

# The noise of the pixels is that of tracks at least this long, and at most so often the usual.
_LONG, _UNUSUAL = 5, 3.0
# A track whose errors are so many times as large as the noise fits no point.
_GROSS = 5.0


@dataclass(frozen=True)
class _Track:
    """Observations of one physical point, and where it is."""

    rows: NDArray[np.int64]  # (n,) of the drive's pixels
    repeats: int | None  # the row whose pixels its first ones repeat
    motions: Array  # (n, 4, 4) from the first frame to each
    point: Array  # (3,) in the first frame
    square_error: float  # square pixels, infinite where there is no point

    @property
    def freedom(self) -> int:
        return 4 * len(self.rows) - 3


class NoiseRedrawn:
    """Draws a drive's noise anew.

    Parameters
    ----------
    drive : Drive
    reference : Trajectory
    slam_settings : SlamSettings
        How frozen steps are found.

    Raises
    ------
    VislamError
        Where the drive has no track that fits the reference's motion.

    Attributes
    ----------
    pixel_std : float
        White noise of each pixel about the tracks' points, pixels.
    twist_std : ndarray, (2,)
        White noise of velocities and angular velocities, m/s and rad/s.
    gyro_bias : ndarray, (3,)
        Mean error of the angular velocities, rad/s.
    redrawn_share : float
        Of the observations: those of tracks that fit a point.
    """

    def __init__(self, drive: Drive, reference: Trajectory, slam_settings: SlamSettings):
        self._drive = drive
        self._twist_rows, self._twist_errors = twist_errors(drive, reference)
        # Differences of neighbours are free of slow errors; the quietest axis, of the reference's.
        white = median_abs_deviation(np.diff(self._twist_errors, axis=0), scale="normal")
        self.twist_std: Array = white.reshape(2, 3).min(axis=1) / np.sqrt(2.0)
        self.gyro_bias: Array = np.mean(self._twist_errors[:, 3:], axis=0)
        self._observation = StereoObservation(drive.camera, (1.0,) * 4)
        self._tracks = _tracks(drive, reference, slam_settings, self._observation)
        self.pixel_std = _pixel_std(drive.name, self._tracks)
        redrawn = sum(len(track.rows) for track in self._tracks if self._fits(track))
        self.redrawn_share = redrawn / len(drive.pixels)

    def draw(self, rng: np.random.Generator, *, twists: bool) -> Drive:
        """Give the drive other pixels and, on request, other twists."""
        pixels = self._drive.pixels.astype(float)
        # In the order of beginning: what a track repeats has been drawn before it.
        for track in self._tracks:
            if track.repeats is not None:
                pixels[track.rows[0]] = pixels[track.repeats]
            if self._fits(track):
                self._observe(track, pixels, rng)
        drive = dataclasses.replace(self._drive, pixels=pixels.astype(np.float32))
        if not twists:
            return drive
        measured = drive.twists.copy()
        white = np.repeat(self.twist_std, 3) * rng.standard_normal(self._twist_errors.shape)
        white[:, 3:] += self.gyro_bias
        measured[self._twist_rows] += white - self._twist_errors
        return dataclasses.replace(drive, twists=measured)

    def _fits(self, track: _Track) -> bool:
        return track.square_error < (_GROSS * self.pixel_std) ** 2 * track.freedom

    def _observe(self, track: _Track, pixels: Array, rng: np.random.Generator) -> None:
        """Write other pixels of a track, but for those that it repeats."""
        noise = self.pixel_std * rng.standard_normal((len(track.rows), 4))
        point, begun_anew = track.point, track.repeats is not None
        if begun_anew:
            (point,) = self._observation.image_points(pixels[track.rows[:1]] - noise[:1])
        warped = moved_points(self._drive.camera, point, track.motions)
        if warped.ahead.all():
            seen = slice(int(begun_anew), None)
            pixels[track.rows[seen]] = (pixels_of(warped.y) + noise)[seen]


def redraw(
    drive: Drive,
    reference: Trajectory,
    slam_settings: SlamSettings,
    prediction_settings: PredictionSettings,
    seeds: Iterable[int],
    *,
    on_progress: Callable[[str], None],
) -> dict[str, Any]:
    """Solve a drive as it is, with other pixels, and with other pixels and twists.

    Returns
    -------
    dict
        ``runs``: a row for each of the three, with the means of ``nees`` and ``ate_m`` and, of the
        last two, the ``nees_std_error``, least and greatest; the ``noise`` that was drawn; and the
        figures of all ``drives``.
    """

    def figures(solution: Solution) -> dict[str, float]:
        return judged(reference, solution.trajectory)

    on_progress(f"the points of {drive.name}")
    noise = NoiseRedrawn(drive, reference, slam_settings)
    itself = figures(solve(drive, slam_settings, prediction_settings))
    rows: list[dict[str, Any]] = [{"name": drive.name, "drives": 1, **itself}]
    drives = []
    seeds = list(seeds)
    for name, twists in (("other pixels", False), ("other pixels and twists", True)):
        drawn = []
        for seed in seeds:
            on_progress(f"{drive.name}, {name}, seed {seed}")
            other = noise.draw(np.random.default_rng([seed, twists]), twists=twists)
            drawn.append(figures(solve(other, slam_settings, prediction_settings)))
        rows.append({"name": name, **_spread(drawn)})
        drives += [
            {"name": name, "seed": seed, **one} for seed, one in zip(seeds, drawn, strict=True)
        ]
    return {
        "runs": rows,
        "noise": {
            "pixel_std": noise.pixel_std,
            "twist_std": noise.twist_std.tolist(),
            "gyro_bias": noise.gyro_bias.tolist(),
            "redrawn_share": noise.redrawn_share,
        },
        "drives": drives,
    }


def _spread(drawn: Sequence[dict[str, float]]) -> dict[str, Any]:
    nees, ate = (np.array([figures[name] for figures in drawn]) for name in ("nees", "ate_m"))
    return {
        "drives": len(drawn),
        "nees": float(nees.mean()),
        "nees_std_error": std_error(nees),
        "nees_least": float(nees.min()),
        "nees_greatest": float(nees.max()),
        "ate_m": float(ate.mean()),
        "ate_least_m": float(ate.min()),
        "ate_greatest_m": float(ate.max()),
    }


def _tracks(
    drive: Drive,
    reference: Trajectory,
    settings: SlamSettings,
    observation: StereoObservation,
) -> list[_Track]:
    """All tracks, in the order of beginning, with their points where the reference gives them."""
    poses = _poses(drive, reference)
    moving = moving_steps(poses)
    table = Tracks(1, settings.frozen_share if settings.track_continuity else None)
    rows_of_key: dict[int, list[tuple[int, int]]] = {}
    last_row: dict[int, int] = {}
    repeats: dict[int, int] = {}
    for k in range(drive.steps):
        ids, pixels = drive.frame(k)
        frame = table.observe(ids, pixels, partial(bool, moving[k]))
        ids_of_keys, _ = table.identity(frame.keys)
        rows = drive.offsets[k] + np.searchsorted(ids, ids_of_keys)
        for key, i, row, copied in zip(
            frame.keys.tolist(),
            ids_of_keys.tolist(),
            rows.tolist(),
            frame.copied.tolist(),
            strict=True,
        ):
            rows_of_key.setdefault(key, []).append((k, row))
            if copied:
                repeats[key] = last_row[i]
            last_row[i] = row
    return [
        _track(drive, poses, np.array(seen), repeats.get(key), observation)
        for key, seen in rows_of_key.items()
    ]


def _track(
    drive: Drive,
    poses: Array,
    frames_and_rows: NDArray[np.int64],
    repeats: int | None,
    observation: StereoObservation,
) -> _Track:
    frames, rows = frames_and_rows.T
    motions = se3.inverse(poses[frames[0]]) @ poses[frames]
    pixels = drive.pixels[rows].astype(float)
    y, weights = observation.image_points(pixels), 1.0 / np.diag(observation.image_point_noise)
    known = np.all(np.isfinite(motions))
    fitted = fitted_point(drive.camera, motions, y, weights) if known else None
    if fitted is None:
        return _Track(rows, repeats, motions, y[0], np.inf)
    square_error = float(np.sum((pixels - pixels_of(fitted.expected)) ** 2))
    return _Track(rows, repeats, motions, fitted.point, square_error)


def _poses(drive: Drive, reference: Trajectory) -> Array:
    """Poses (T, 4, 4) of the reference at the drive's frames, NaN where it has none."""
    poses = np.full((drive.steps, 4, 4), np.nan)
    known, frames = associate_stamps(reference.stamps, drive.feature_stamps)
    poses[frames] = reference.T_world_body[known]
    return poses


def _pixel_std(drive_name: str, tracks: Sequence[_Track]) -> float:
    """White noise of each pixel, of the tracks that are long and not unusual."""
    long_ones = [t for t in tracks if len(t.rows) >= _LONG and np.isfinite(t.square_error)]
    if not long_ones:
        raise VislamError(
            f"{drive_name}: no track of {_LONG} frames fits the reference's motion: "
            "is it the reference of this drive?"
        )
    of_long = np.array([(t.square_error, t.freedom) for t in long_ones])
    mean_squares = of_long[:, 0] / of_long[:, 1]
    usual = of_long[mean_squares < _UNUSUAL * np.median(mean_squares)]
    return float(np.sqrt(usual[:, 0].sum() / usual[:, 1].sum()))
