# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive with exact ground truth: a car, a roadside scene and a stereo tracker.

It has what the real drives have, each by a setting: white pixel and twist noise, disparities that
are wrong by the same amount for all the life of a track, a constant gyroscope bias, tracks that
slide over the scene, and frozen steps. At a frozen step every track that goes on repeats its last
pixels bit for bit, new landmarks are first seen, and from then on the old ids stand for other
points: those that lie, but for the noise, at the stale left pixels at that step, in a scene that
is about as far away there as it was a step before.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, pixels_of
from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.core.settings import LARGEST_RATE, LARGEST_WHOLE, MOST_FRAMES, changed, setting
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.simulation.motion import drive_poses, in_first_pose
from vislam_ros.data.simulation.simulated_drive import SimulatedDrive, SimulatedLandmarks
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory, moving_steps, nanoseconds
from vislam_ros.data.trajectory_files import read_trajectory
from vislam_ros.errors import VislamError, of_type

Array = NDArray[np.float64]

# A camera like KITTI's, with its usual mount a little out of true.
INTRINSICS = np.array([[707.0912, 0.0, 601.8873], [0.0, 707.0912, 183.1104], [0.0, 0.0, 1.0]])
BASELINE = 0.54
IMAGE_WIDTH, IMAGE_HEIGHT = 1242, 375
T_BODY_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 1.1], [-1.0, 0.0, 0.0, 0.3], [0.0, -1.0, 0.0, -0.2], [0.0, 0.0, 0.0, 1.0]]
) @ se3.exp([0.0, 0.0, 0.0, 0.01, -0.008, 0.004])

_FIRST_SECOND = 1_700_000_000.0
_PERIOD = 0.1

_MEAN_TRACK = 13.0  # steps that a track is seen, which the two below were chosen to give
_SHORTEST_TRACK = 2
_MEAN_LIFE = 20.0  # steps until a tracker loses a point that stays in view
_MIN_DEPTH = 2.0  # metres
# New points: disparity is log-normal. What is seen of them then has the median of drive 03, 6.7
# pixels, and like there a twentieth under 1.3.
_MEDIAN_DISPARITY, _LOG_DISPARITY_STD = 7.15, 0.75  # pixels, 1
_HALF_ROAD = 4.0  # metres to either side where nothing stands
_CAMERA_HEIGHT = 1.65  # metres
# A track that jumps to another point at a frozen step finds it at nearly the same disparity.
_LOG_JUMP_STD = 0.02


@dataclass(frozen=True)
class SimulationSettings:
    """What is simulated."""

    steps: int = setting(600, "Feature frames, ten a second", minimum=2, maximum=MOST_FRAMES)
    landmarks: int = setting(3000, "Tracks in the whole drive", minimum=1, maximum=MOST_FRAMES)
    pixel_noise_std: float = setting(
        1.0, "White noise of each of the four pixels [px]", minimum=0.0, maximum=LARGEST_PIXEL
    )
    disparity_offset_std: float = setting(
        0.0,
        "Error of a disparity that stays for the life of its track [px]",
        minimum=0.0,
        maximum=LARGEST_PIXEL,
    )
    velocity_noise_std: float = setting(
        0.1,
        "White noise of one velocity sample on each axis [m/s]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    angular_velocity_noise_std: float = setting(
        0.01,
        "White noise of one angular velocity sample on each axis [rad/s]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    gyro_bias: tuple[float, float, float] = setting(
        (0.002, 0.002, 0.002),
        "Constant error of the measured angular velocity [rad/s]",
        minimum=-LARGEST_RATE,
        maximum=LARGEST_RATE,
    )
    outlier_share: float = setting(
        0.03, "Share of the tracks that slide over the scene", minimum=0.0, maximum=1.0
    )
    frozen_share: float = setting(
        0.0,
        "Share of the steps at which all tracks repeat their last pixels and new ones begin; "
        "at 0 new ones may begin at any step",
        minimum=0.0,
        maximum=0.5,
    )
    seed: int = setting(0, "Seed of everything random", minimum=0, maximum=LARGEST_WHOLE)


def simulate(
    settings: SimulationSettings | None = None,
    along: Trajectory | Path | str | None = None,
    **values: Any,
) -> SimulatedDrive:
    """Simulate a drive; equal settings give equal drives, to the last bit.

    Parameters
    ----------
    settings : SimulationSettings, optional
    along : Trajectory, Path or str, optional
        A recorded motion, or its file, of a body like KITTI's, whose first poses and stamps are
        taken in place of the simulated car's.
    **values
        Settings by name that are put over these, such as ``steps=300``.

    Raises
    ------
    VislamError
        Where a setting is out of its range, or ``along`` has fewer poses than there are to be
        steps; where one is of a wrong type.
    """
    settings = settings or SimulationSettings()
    of_type("settings", settings, SimulationSettings, "each by name, as steps=300")
    settings = changed(settings, **values)
    if isinstance(along, (str, Path)):
        along = read_trajectory(along)
    motion_rng, twist_rng, schedule_rng, track_rng, offset_rng = map(
        np.random.default_rng, np.random.SeedSequence(settings.seed).spawn(5)
    )
    if along is None:
        seconds: Array = _FIRST_SECOND + _PERIOD * np.arange(settings.steps, dtype=np.float64)
        T_world_body = drive_poses(settings.steps, _PERIOD, motion_rng)
    else:
        of_type("along", along, Trajectory, "a Trajectory or the path of its file")
        seconds, T_world_body = _recorded(along, settings.steps)
    stamps = nanoseconds(seconds)
    tau = np.diff(stamps) / NANOSECONDS
    twists = se3.log(se3.inverse(T_world_body[:-1]) @ T_world_body[1:]) / tau[:, None]
    true_twists = np.concatenate([twists[:1], twists])

    moving = moving_steps(T_world_body)
    frozen = _frozen_steps(moving, settings, schedule_rng)
    births = _births(moving, frozen, settings, schedule_rng)

    camera = StereoCamera.from_matrices(INTRINSICS, BASELINE, T_BODY_CAMERA)
    tracker = _Tracker(camera, settings, track_rng, offset_rng)
    for k in range(settings.steps):
        tracker.step(T_world_body[k], int(births[k]), bool(moving[k]), bool(frozen[k]))

    pixels = np.concatenate(tracker.seen_pixels)
    drive = Drive(
        name="simulated",
        camera=camera,
        image_size=image_size_that_holds(pixels),
        twist_stamps=stamps,
        twists=_measured(true_twists, settings, twist_rng),
        feature_stamps=stamps,
        offsets=np.cumsum([0, *(len(ids) for ids in tracker.seen_ids)]),
        ids=np.concatenate(tracker.seen_ids),
        pixels=pixels,
        ground_truth=Trajectory.from_matrices(stamps, T_world_body),
    )
    return SimulatedDrive(drive, seconds, T_world_body, true_twists, frozen, tracker.landmarks())


def _recorded(along: Trajectory, steps: int) -> tuple[Array, Array]:
    """Seconds (n,) and poses (n, 4, 4), in the first one's frame, of a recorded motion."""
    if steps > len(along):
        raise VislamError(
            f"along: a motion of {len(along)} poses has no {steps} steps: take fewer"
        )
    return along.stamps[:steps] / NANOSECONDS, in_first_pose(along.T_world_body[:steps])


def _measured(twists: Array, settings: SimulationSettings, rng: np.random.Generator) -> Array:
    std = np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3)
    bias = np.array([0.0, 0.0, 0.0, *settings.gyro_bias])
    return twists + bias + std * rng.standard_normal(twists.shape)


def _frozen_steps(
    moving: NDArray[np.bool_], settings: SimulationSettings, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Spread the frozen steps, never two in a row, over those at which the car moves."""
    frozen = np.zeros(len(moving), dtype=bool)
    candidates = np.flatnonzero(moving)
    count = round(settings.frozen_share * settings.steps)
    if count == 0 or len(candidates) == 0:
        return frozen
    gap = max(len(candidates) / count, 2.0)
    middles = gap * (np.arange(int(len(candidates) / gap)) + 0.5)
    jitter = rng.uniform(-0.5, 0.5, len(middles)) * (gap - 2)
    frozen[candidates[np.floor(middles + jitter).astype(int)]] = True
    return frozen


def _births(
    moving: NDArray[np.bool_],
    frozen: NDArray[np.bool_],
    settings: SimulationSettings,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Tracks that begin at each step (T,), so that their number in view stays about the same."""
    share_of_step = moving / (np.sum(moving) + _MEAN_TRACK)
    if np.any(frozen):
        # A frozen step makes up for all the tracks lost since the last one.
        share_until = np.cumsum(share_of_step)[frozen]
        share_of_step = np.zeros(len(moving))
        share_of_step[frozen] = np.diff(share_until, prepend=0.0)
    share_of_step[0] = 1.0 - np.sum(share_of_step[1:])
    return rng.multinomial(settings.landmarks, share_of_step)


@dataclass
class _Live:
    """Tracks in view, sorted by id."""

    ids: NDArray[np.uint32]
    generations: NDArray[np.uint32]
    points: Array  # (n, 3) world
    slides: Array  # (n, 3) world, metres a step
    lives: Array  # (n,) steps of motion left
    image_points: Array  # (n, 3) true (u_left, u_right, v) at the last step
    offsets: Array  # (n,) of the right pixels
    pixels: NDArray[np.float32]  # (n, 4) at the last step

    def keep(self, rows: NDArray[np.bool_]) -> None:
        for name, value in vars(self).items():
            setattr(self, name, value[rows])


@dataclass
class _Tracker:
    """Observes the scene step by step."""

    camera: StereoCamera
    settings: SimulationSettings
    rng: np.random.Generator
    offset_rng: np.random.Generator
    seen_ids: list[NDArray[np.uint32]] = field(default_factory=list)
    seen_pixels: list[NDArray[np.float32]] = field(default_factory=list)
    _points: list[tuple[NDArray[np.uint32], NDArray[np.uint32], Array, Array]] = field(
        default_factory=list
    )
    _ids_given: int = 0

    def __post_init__(self) -> None:
        self._live = self._new_tracks(0, np.eye(4))

    def step(self, T_world_body: Array, births: int, moving: bool, frozen: bool) -> None:
        """Observe one frame."""
        T_world_camera = T_world_body @ self.camera.T_body_camera
        live = self._live
        live.points = live.points + live.slides
        if moving:
            live.lives = live.lives - 1
        live.keep(live.lives > 0)
        if frozen:
            self._jump(T_world_camera)
        else:
            live.keep(self._in_view(T_world_camera, live.points))
            self._observe(live, T_world_camera)
        new = self._new_tracks(births, T_world_camera)
        self._observe(new, T_world_camera)
        self._live = _Live(
            **{
                name: np.concatenate([value, getattr(new, name)])
                for name, value in vars(live).items()
            }
        )
        self.seen_ids.append(self._live.ids)
        self.seen_pixels.append(self._live.pixels)

    def landmarks(self) -> SimulatedLandmarks:
        """All the points so far, sorted by id and generation."""
        ids, generations, positions, slides = (
            np.concatenate(parts) for parts in zip(*self._points, strict=True)
        )
        order = np.lexsort((generations, ids))
        return SimulatedLandmarks(
            ids[order], generations[order], positions[order], np.any(slides[order] != 0, axis=1)
        )

    def _observe(self, tracks: _Live, T_world_camera: Array) -> None:
        y = self.camera.project(_transform(se3.inverse(T_world_camera), tracks.points))
        tracks.image_points = y
        noise = self.settings.pixel_noise_std * self.rng.standard_normal((len(y), 4))
        noise[:, 2] += tracks.offsets
        tracks.pixels = (pixels_of(y) + noise).astype(np.float32)

    def _in_view(self, T_world_camera: Array, points: Array) -> NDArray[np.bool_]:
        points_camera = _transform(se3.inverse(T_world_camera), points)
        ahead = points_camera[:, 2] > _MIN_DEPTH
        points_camera[~ahead] = [0, 0, 1]
        return ahead & _in_images(self.camera.project(points_camera))

    def _jump(self, T_world_camera: Array) -> None:
        """Let every live track go on from its stale pixels with the point that lies there now."""
        live = self._live
        jump = np.exp(_LOG_JUMP_STD * self.rng.standard_normal(len(live.ids)))
        y = live.image_points.copy()
        y[:, 1] = y[:, 0] - jump * (y[:, 0] - y[:, 1])
        live.image_points = y
        live.points = _transform(T_world_camera, self.camera.triangulate(y))
        live.generations = live.generations + np.uint32(1)
        self._points.append((live.ids, live.generations, live.points, live.slides))

    def _new_tracks(self, count: int, T_world_camera: Array) -> _Live:
        points_camera = _roadside_points(count, self.camera, self.rng)
        slides = _slides(points_camera, self.camera.fx, self.settings.outlier_share, self.rng)
        lives = self.rng.exponential(_MEAN_LIFE - _SHORTEST_TRACK, count) + _SHORTEST_TRACK
        tracks = _Live(
            ids=np.arange(self._ids_given, self._ids_given + count, dtype=np.uint32),
            generations=np.zeros(count, dtype=np.uint32),
            points=_transform(T_world_camera, points_camera),
            slides=slides @ T_world_camera[:3, :3].T,
            lives=lives,
            image_points=np.zeros((count, 3)),
            offsets=self.settings.disparity_offset_std * self.offset_rng.standard_normal(count),
            pixels=np.zeros((count, 4), dtype=np.float32),
        )
        self._ids_given += count
        self._points.append((tracks.ids, tracks.generations, tracks.points, tracks.slides))
        return tracks


def _roadside_points(count: int, camera: StereoCamera, rng: np.random.Generator) -> Array:
    """Points (count, 3) in the left camera: in both images, beside the road, not underground."""
    points = np.empty((0, 3))
    while len(points) < count:
        n = 4 * count
        disparity = _MEDIAN_DISPARITY * np.exp(_LOG_DISPARITY_STD * rng.standard_normal(n))
        z = camera.fx_baseline / disparity
        x = (rng.uniform(0, IMAGE_WIDTH, n) - camera.cx) * z / camera.fx
        # Near things reach a few metres up, far ones are hills.
        y = rng.uniform(-3.0 - 0.12 * z, _CAMERA_HEIGHT)
        drawn = np.column_stack([x, y, z])
        possible = (z > _MIN_DEPTH) & (np.abs(x) > _HALF_ROAD)
        points = np.concatenate([points, drawn[possible & _in_images(camera.project(drawn))]])
    return points[:count]


def _in_images(y: Array) -> NDArray[np.bool_]:
    """Whether image points (n, 3) lie in both images."""
    low, high = [0, 0, 0], [IMAGE_WIDTH - 1, IMAGE_WIDTH - 1, IMAGE_HEIGHT - 1]
    return np.all((y >= low) & (y <= high), axis=1)


def _slides(points: Array, fx: float, share: float, rng: np.random.Generator) -> Array:
    """Motion (n, 3) of each point across the view in a step, metres; of most points none."""
    sliding = rng.random(len(points)) < share
    angle = rng.uniform(0, 2 * np.pi, len(points))
    rate = rng.uniform(2.0, 6.0, len(points)) * sliding  # pixels a step
    across = np.column_stack([np.cos(angle), 0.3 * np.sin(angle), np.zeros(len(points))])
    return across * (rate * points[:, 2] / fx)[:, None]


def _transform(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])
