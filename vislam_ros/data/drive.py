# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A drive in memory: all that the graph hears, from whatever file it came."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.ranges import GAP, PIXEL, TURN_RATE, VELOCITY
from vislam_ros.core.tracking.refusals import RefusalCounts
from vislam_ros.data.finding import Finding
from vislam_ros.data.missing_motion import missing_samples
from vislam_ros.data.trajectory import (
    LATEST_SECOND,
    NANOSECONDS,
    Trajectory,
    nanoseconds,
    path_length,
    stamp_text,
)
from vislam_ros.errors import VislamError, of_type

# A sensor's samples are as far apart as this, and those of whoever took the unit wrong are not: at
# 10 Hz milliseconds are a hundred seconds apart, or a hundred nanoseconds [ns].
_SHORTEST_STEP, _LONGEST_STEP = 500_000, 5_000_000_000


@dataclass(frozen=True)
class Drive:
    """Stereo feature tracks and body twists, held sparsely.

    A drive read from a dataset and the same drive read back from its bag are equal field for
    field, so whatever is computed from either is equal too.

    Attributes
    ----------
    name : str
        What to call it, such as the file's stem.
    camera : StereoCamera
    image_size : tuple of int, (2,)
        Width and height, pixels; the smallest that holds every feature where it is not known.
    twist_stamps : ndarray of int64, (N,)
        Nanoseconds, strictly increasing.
    twists : ndarray, (N, 6)
        ``[v; omega]`` in the body frame, metres and radians a second. The twist with stamp
        ``t[k+1]`` is the one that holds over the step from ``t[k]`` to ``t[k+1]``. All velocities
        are NaN where a gyroscope alone measures the motion.
    accelerations : ndarray, (N, 3), or None
        Specific force in the body frame beside the twists, m/s^2, NaN where it was not measured;
        None where it never was. It tells how a body that stands is levelled at its start.
    feature_stamps : ndarray of int64, (T,)
        Nanoseconds, strictly increasing.
    offsets : ndarray of int64, (T + 1,)
        Frame ``k`` is made of the rows ``offsets[k]:offsets[k + 1]`` of the next two.
    ids : ndarray of uint32, (n,)
        Track of each observation, increasing inside a frame.
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    noise : ndarray of float32, (n,), or None
        Standard deviation of each observation, pixels; None where the source states none.
    ground_truth : Trajectory or None
        Poses of the body in its first pose's frame, where they are known.
    notes : tuple of str
        What a reader repaired or left out, a line each.
    refused : RefusalCounts
        Messages that a reader refused, as the nodes would.
    findings : tuple of Finding
        What a dataset's reader found wrong and repaired, with figures; each has its note. They are
        no part of what a bag keeps.
    """

    name: str
    camera: StereoCamera
    image_size: tuple[int, int]
    twist_stamps: NDArray[np.int64]
    twists: NDArray[np.float64]
    feature_stamps: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ids: NDArray[np.uint32]
    pixels: NDArray[np.float32]
    noise: NDArray[np.float32] | None = None
    accelerations: NDArray[np.float64] | None = None
    ground_truth: Trajectory | None = None
    notes: tuple[str, ...] = ()
    refused: RefusalCounts = field(default_factory=RefusalCounts)
    findings: tuple[Finding, ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        truth = self.ground_truth
        known = "" if truth is None else f", {path_length(truth):.1f} m in truth"
        return (
            f"<Drive {self.name!r}: {self.steps} frames, {len(self.ids)} observations of "
            f"{self.tracks} tracks, {len(self.twists)} samples of motion, {self.duration:.1f} s"
            f"{known}>"
        )

    @classmethod
    def from_tracks(
        cls,
        stamps: ArrayLike,
        ids: Sequence[ArrayLike],
        pixels: Sequence[ArrayLike],
        twists: ArrayLike,
        camera: StereoCamera,
        *,
        twist_stamps: ArrayLike | None = None,
        noise: Sequence[ArrayLike] | None = None,
        ground_truth: Trajectory | None = None,
        name: str = "tracks",
    ) -> "Drive":
        """Build a drive from what a tracker and a motion sensor give, frame by frame.

        Parameters
        ----------
        stamps : array_like, (T,)
            Of the frames: seconds where they are floats, nanoseconds where they are integers.
        ids : sequence of T array_like of int, (n_k,) each
            The tracks that frame ``k`` sees, from 0 to 4294967295, each once, in any order.
        pixels : sequence of T array_like, (n_k, 4) each
            Their ``u_left, v_left, u_right, v_right`` in the rectified images.
        twists : array_like, (T, 6), or (N, 6) with ``twist_stamps``
            ``[v; omega]`` of the body, metres and radians a second. The twist of a stamp holds
            over the time that ends there: row ``k`` for the step from frame ``k - 1`` to ``k``.
            Velocities that are NaN, all of them, are not measured: a gyroscope is enough. Other
            rows with a NaN are left out.
        camera : StereoCamera
        twist_stamps : array_like, (N,), optional
            As ``stamps``, where twists have stamps of their own.
        noise : sequence of T array_like, (n_k,) each, optional
            Standard deviation of each observation, pixels, in the order of ``ids``.
        ground_truth : Trajectory, optional
        name : str, optional

        Raises
        ------
        VislamError
            Naming the argument, the frame and what is wrong with it.
        """
        of_type("camera", camera, StereoCamera, "one of StereoCamera.from_matrices")
        feature_stamps = _stamps("stamps", stamps)
        motion_stamps = feature_stamps
        if twist_stamps is not None:
            motion_stamps = _stamps("twist_stamps", twist_stamps)
        motion = _numbers("twists", twists)
        if motion.shape != (len(motion_stamps), 6):
            raise VislamError(
                f"twists: have shape {motion.shape}, not ({len(motion_stamps)}, 6), one for each "
                "of their stamps"
            )
        missing = missing_samples(motion, "twists")
        VELOCITY.require(np.nan_to_num(motion[:, :3], posinf=np.inf, neginf=-np.inf), "twists")
        TURN_RATE.require(motion[~missing, 3:], "twists")
        for what, frames in (("ids", ids), ("pixels", pixels)):
            of_type(what, frames, (Sequence, np.ndarray), "a list with an array for each frame")
            if len(frames) != len(feature_stamps):
                raise VislamError(f"{what}: {len(frames)} frames for {len(feature_stamps)} stamps")
        seen = [_frame(k, *frame) for k, frame in enumerate(zip(ids, pixels, strict=True))]
        stated = None if noise is None else _noise(ids, noise)
        all_pixels = np.concatenate([frame_pixels for _, frame_pixels in seen])
        return cls(
            name=name,
            camera=camera,
            image_size=image_size_that_holds(all_pixels),
            twist_stamps=motion_stamps,
            twists=motion,
            feature_stamps=feature_stamps,
            offsets=np.cumsum([0, *(len(frame_ids) for frame_ids, _ in seen)]),
            ids=np.concatenate([frame_ids for frame_ids, _ in seen]),
            pixels=all_pixels,
            noise=stated,
            ground_truth=ground_truth,
        ).without_samples(missing)

    def with_finding(self, finding: Finding) -> "Drive":
        """Drive with one more finding, and its note."""
        return replace(self, findings=(*self.findings, finding), notes=(*self.notes, finding.note))

    def without_samples(self, missing: NDArray[np.bool_]) -> "Drive":
        """Drive without those (N,) of its samples of motion that hold a NaN, and a note on it."""
        if not missing.any():
            return self
        first = stamp_text(int(self.twist_stamps[np.argmax(missing)]))
        forces = self.accelerations
        note = (
            f"Left out {int(missing.sum())} of {len(missing)} samples of motion with a NaN, the "
            f"first at {first} s."
        )
        return replace(
            self,
            twist_stamps=self.twist_stamps[~missing],
            twists=self.twists[~missing],
            accelerations=None if forces is None else forces[~missing],
            notes=(*self.notes, note),
        )

    @property
    def measures_velocity(self) -> bool:
        """Whether the twists have velocities, and are not those of a gyroscope alone."""
        return bool(len(self.twists)) and not np.isnan(self.twists[:, :3]).any()

    def moved_by(self, motion_source: str) -> "Drive":
        """Drive with the motion that a source of :data:`MOTION_SOURCES` measures.

        Raises
        ------
        VislamError
            Where that is the twists and they have no velocity.
        """
        if motion_source == "twist" and not self.measures_velocity:
            raise VislamError(
                f"{self.name}: has no velocities, which motion_source: twist wants: take gyro"
            )
        if motion_source != "gyro" and (self.measures_velocity or not len(self.twists)):
            return self
        twists = self.twists.copy()
        twists[:, :3] = np.nan
        return replace(self, twists=twists)

    def with_frames(self, kept: NDArray[np.bool_]) -> "Drive":
        """Drive with some (S,) of its feature frames, and all of its motion."""
        counts = np.diff(self.offsets)
        rows = np.repeat(kept, counts)
        return replace(
            self,
            feature_stamps=self.feature_stamps[kept],
            offsets=np.concatenate([[0], np.cumsum(counts[kept])]),
            ids=self.ids[rows],
            pixels=self.pixels[rows],
            noise=None if self.noise is None else self.noise[rows],
        )

    @property
    def steps(self) -> int:
        """Number of feature frames."""
        return len(self.feature_stamps)

    @property
    def tracks(self) -> int:
        """Number of different ids."""
        return len(np.unique(self.ids))

    @property
    def duration(self) -> float:
        """Seconds from the first feature frame to the last."""
        if not self.steps:
            return 0.0
        return float(self.feature_stamps[-1] - self.feature_stamps[0]) * 1e-9

    def frame(self, k: int) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        """Ids (n,) and pixels (n, 4) of frame ``k``."""
        rows = slice(self.offsets[k], self.offsets[k + 1])
        return self.ids[rows], self.pixels[rows]

    def followed(
        self, k: int
    ) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32]]:
        """Ids (n,) and pixels (n, 4), (n, 4) of the tracks that ``k`` and ``k + 1`` both have."""
        ids_before, before = self.frame(k)
        ids_after, after = self.frame(k + 1)
        ids, first, second = np.intersect1d(
            ids_before, ids_after, assume_unique=True, return_indices=True
        )
        return ids, before[first], after[second]

    def noise_of(self, k: int) -> NDArray[np.float32] | None:
        """Stated noise (n,) of frame ``k``, pixels; None where there is none."""
        return None if self.noise is None else self.noise[self.offsets[k] : self.offsets[k + 1]]


def image_size_that_holds(pixels: NDArray[np.float32]) -> tuple[int, int]:
    """Width and height of the smallest image, at least 1 x 1, with room for pixels (n, 4)."""
    if not len(pixels):
        return 1, 1
    u, v = pixels[:, 0::2].max(), pixels[:, 1::2].max()
    return max(int(np.floor(u)) + 1, 1), max(int(np.floor(v)) + 1, 1)


def _numbers(what: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise VislamError(f"{what}: are no array of numbers: {error}") from error


def _stamps(what: str, stamps: ArrayLike) -> NDArray[np.int64]:
    """Nanoseconds (n,) of stamps in seconds, which are floats, or in nanoseconds, integers."""
    given = np.asarray(stamps)
    if given.ndim != 1 or not len(given) or given.dtype.kind not in "iuf":
        raise VislamError(f"{what}: have shape {given.shape} of {given.dtype}, not (n,) numbers")
    are_seconds = given.dtype.kind == "f"
    if are_seconds and not (np.isfinite(given).all() and given.max() < LATEST_SECOND):
        raise VislamError(f"{what}: {given.max()} is no time in seconds, which floats are")
    result = nanoseconds(given.astype(float)) if are_seconds else given.astype(np.int64)
    steps = np.diff(result)
    if result[0] < 0 or np.any(steps <= 0):
        k = int(np.argmin(np.concatenate([[result[0] + 1], steps]) > 0))
        raise VislamError(f"{what}[{k}]: {given[k]} is negative or not later than the one before")
    if len(steps) and not _SHORTEST_STEP <= np.median(steps) <= _LONGEST_STEP:
        unit, other = ("seconds", "integers") if are_seconds else ("nanoseconds", "floats")
        raise VislamError(
            f"{what}: are {np.median(np.diff(given)):g} {unit} apart, which no sensor is: floats "
            f"are seconds and integers nanoseconds; are these meant to be {other}?"
        )
    GAP.require(steps / NANOSECONDS, what)
    return result


def _frame(
    k: int, ids: ArrayLike, pixels: ArrayLike
) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
    """Ids (n,), in order, and pixels (n, 4) of frame ``k``."""
    given = np.asarray(ids)
    seen = _numbers(f"frame {k}: pixels", pixels).astype(np.float32)
    if given.size == seen.size == 0:
        return np.empty(0, dtype=np.uint32), np.empty((0, 4), dtype=np.float32)
    if given.ndim != 1 or given.dtype.kind not in "iu" or seen.shape != (len(given), 4):
        raise VislamError(
            f"frame {k}: has ids of shape {given.shape} and {given.dtype}, and pixels of shape "
            f"{seen.shape}: give (n,) integers and (n, 4) numbers"
        )
    if given.min() < 0 or given.max() > np.iinfo(np.uint32).max:
        raise VislamError(f"frame {k}: ids go from {given.min()} to {given.max()}, not 32 bits")
    order = np.argsort(given, kind="stable")
    result = given[order].astype(np.uint32)
    (twice,) = np.nonzero(result[1:] == result[:-1])
    if len(twice):
        raise VislamError(f"frame {k}: has track {result[twice[0]]} twice")
    if not np.all(np.isfinite(seen)):
        track = given[np.argmin(np.isfinite(seen).all(axis=1))]
        raise VislamError(f"frame {k}: a pixel of track {track} is not finite")
    PIXEL.require(seen, f"frame {k}")
    return result, seen[order]


def _noise(ids: Sequence[ArrayLike], noise: Sequence[ArrayLike]) -> NDArray[np.float32]:
    """Noise (n,) of all observations, in the order of their ids, of frames that are right."""
    if len(noise) != len(ids):
        raise VislamError(f"noise: {len(noise)} frames for {len(ids)} of ids")
    frames = [np.empty(0, dtype=np.float32)]
    for k, (frame_ids, stated) in enumerate(zip(ids, noise, strict=True)):
        values = np.asarray(stated, dtype=np.float32)
        given = np.asarray(frame_ids)
        if values.shape != given.shape:
            raise VislamError(
                f"frame {k}: has noise of shape {values.shape} for ids of shape {given.shape}"
            )
        if not np.all(np.isfinite(values) & (values > 0)):
            raise VislamError(f"frame {k}: the noise of an observation is not finite and above 0")
        frames.append(values[np.argsort(given, kind="stable")])
    return np.concatenate(frames)
