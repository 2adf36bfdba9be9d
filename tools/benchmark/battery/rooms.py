# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Walks, flights and take-offs in a room: bodies that are no vehicle, with truth.

A stereo camera like that of a small drone moves through a box. Points lie on its walls, and a
track lasts until it leaves an image or the tracker loses it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera, pixels_of
from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory

Array = NDArray[np.float64]

_INTRINSICS = np.array([[458.0, 0.0, 376.0], [0.0, 458.0, 240.0], [0.0, 0.0, 1.0]])
_BASELINE = 0.11
_WIDTH, _HEIGHT = 752, 480
# Looks ahead along the body's x axis.
_T_BODY_CAMERA = np.array(
    [[0.0, 0.0, 1.0, 0.05], [-1.0, 0.0, 0.0, 0.05], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
_FIRST_STAMP = 10**9 * NANOSECONDS

_TWIST_STD = np.repeat([0.1, 0.01], 3)  # metres and radians a second
_BIAS_STD = 0.005  # radians a second
_MIN_DEPTH = 0.3  # metres
_MEAN_LIFE = 3.0  # seconds until a tracker loses a point that stays in view
_SHORTEST_TRACK = 2
# Waves that a motion is made of, cycles a second.
_SLOWEST_WAVE, _FASTEST_WAVE, _WAVES = 0.05, 0.4, 5
_SWING = 0.2  # standard deviation of the position, of the room's size
_SET_OFF = 0.5  # seconds in which a body that stood gets as fast as its course is
_SLOWEST_SLIDE, _FASTEST_SLIDE = 20.0, 60.0  # pixels a second


@dataclass(frozen=True)
class RoomSettings:
    """A room, and how a body moves in it.

    Attributes
    ----------
    size : tuple of float, (3,)
        Of the room, metres.
    speed : float
        The greatest, metres a second.
    turn_rate : float
        The greatest of the heading, radians a second.
    tilt : float
        Standard deviation of roll and pitch, radians.
    rest : float
        Seconds for which it stands before it moves off.
    """

    size: tuple[float, float, float]
    speed: float
    turn_rate: float
    tilt: float
    rest: float = 0.0


WALK = RoomSettings((14.0, 10.0, 3.0), 1.5, 1.2, 0.06)
FLIGHT = RoomSettings((8.0, 8.0, 4.0), 3.0, 3.0, 0.2)
TAKE_OFF = replace(FLIGHT, rest=15.0)


def simulate_in_room(
    settings: RoomSettings,
    *,
    features: int,
    rate: int,
    seconds: float,
    sliding_share: float,
    rng: np.random.Generator,
    pixel_noise_std: float = 0.7,
) -> Drive:
    """Simulate tracks and twists of a motion; the drive holds its ground truth.

    Parameters
    ----------
    settings : RoomSettings
    features : int
        Tracks in a frame.
    rate : int
        Frames a second.
    seconds : float
        How long the motion lasts.
    sliding_share : float
        Of the tracks, which slide over the scene.
    rng : Generator
        Of everything random.
    pixel_noise_std : float
        White noise of each of the four pixels.
    """
    steps = round(seconds * rate)
    T_room_body = room_poses(settings, np.arange(steps) / rate, rng)
    period = NANOSECONDS // rate
    stamps = _FIRST_STAMP + period * np.arange(steps, dtype=np.int64)
    twists = _measured_twists(T_room_body, period / NANOSECONDS, rng)
    camera = StereoCamera.from_matrices(_INTRINSICS, _BASELINE, _T_BODY_CAMERA)
    tracker = _Tracker(camera, np.array(settings.size), features, rate, sliding_share, rng)
    ids, pixels = [], []
    for T in T_room_body:
        tracks = tracker.step(T)
        noise = pixel_noise_std * rng.standard_normal((len(tracks.ids), 4))
        ids.append(tracks.ids)
        pixels.append(pixels_of(tracks.image_points) + noise)
    return Drive.from_tracks(
        stamps,
        ids,
        pixels,
        twists,
        camera,
        ground_truth=Trajectory.from_matrices(stamps, se3.inverse(T_room_body[0]) @ T_room_body),
        name="room",
    )


def room_poses(settings: RoomSettings, t: Array, rng: np.random.Generator) -> Array:
    """Poses (n, 4, 4) at the seconds ``t`` (n,), in a frame in the room's middle."""
    position = _waves(t, 3, rng) * (_SWING * np.array(settings.size))
    speed = np.linalg.norm(np.gradient(position, t, axis=0), axis=1)
    position *= min(1.0, settings.speed / speed.max())
    tilt = settings.tilt * _waves(t, 2, rng)
    heading = np.cumsum(_waves(t, 1, rng)[:, 0])
    heading *= settings.turn_rate / np.abs(np.gradient(heading, t)).max()
    along = _seconds_on_course(t, settings.rest) if settings.rest else t
    course = np.column_stack([position, tilt, heading])
    course = np.column_stack([np.interp(along, t, numbers) for numbers in course.T])
    zero = np.zeros(len(t))
    T = np.tile(np.eye(4), (len(t), 1, 1))
    T[:, :3, :3] = se3.exp_rotation(np.column_stack([zero, zero, course[:, 5]])) @ (
        se3.exp_rotation(np.column_stack([course[:, 3:5], zero]))
    )
    T[:, :3, 3] = course[:, :3]
    return T


def _seconds_on_course(t: Array, rest: float) -> Array:
    """Seconds (n,) at full speed to where a body is on its course that has stood for so long."""
    moving = np.maximum(t - t[0] - rest, 0.0)
    faster = moving**2 / (2.0 * _SET_OFF)
    return t[0] + np.where(moving < _SET_OFF, faster, moving - 0.5 * _SET_OFF)


def _waves(t: Array, count: int, rng: np.random.Generator) -> Array:
    """Sums (n, count) of waves, of about unit standard deviation."""
    frequency = rng.uniform(_SLOWEST_WAVE, _FASTEST_WAVE, (_WAVES, count))
    phase = rng.uniform(0, 2 * np.pi, (_WAVES, count))
    waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase)
    return np.asarray(np.sqrt(2 / _WAVES) * waves.sum(axis=1))


def _measured_twists(T_room_body: Array, tau: float, rng: np.random.Generator) -> Array:
    moved = se3.log(se3.inverse(T_room_body[:-1]) @ T_room_body[1:]) / tau
    true = np.concatenate([moved[:1], moved])
    twists = true + _TWIST_STD * rng.standard_normal(true.shape)
    twists[:, 3:] += _BIAS_STD * rng.standard_normal(3)
    return np.asarray(twists)


@dataclass
class _Live:
    """Tracks in view, sorted by id."""

    ids: NDArray[np.int64]
    points: Array  # (n, 3) room
    lives: Array  # (n,) frames left
    slides: Array  # (n, 3) of the image point, pixels a frame
    slid: Array  # (n, 3) since the track began, pixels
    image_points: Array  # (n, 3) as they are seen, without noise

    def keep(self, rows: NDArray[np.bool_]) -> None:
        for name, value in vars(self).items():
            setattr(self, name, value[rows])


@dataclass
class _Tracker:
    """Observes the walls frame by frame."""

    camera: StereoCamera
    size: Array
    features: int
    rate: int
    sliding_share: float
    rng: np.random.Generator
    _ids_given: int = 0

    def __post_init__(self) -> None:
        self._live = self._new_tracks(0, np.eye(4))

    def step(self, T_room_body: Array) -> _Live:
        """Follow the tracks into a frame, and begin others in place of those that ended."""
        T_room_camera = T_room_body @ self.camera.T_body_camera
        live = self._live
        live.lives = live.lives - 1
        live.slid = live.slid + live.slides
        points, ahead = self._project(live.points, T_room_camera)
        live.image_points = points + live.slid
        live.keep((live.lives > 0) & ahead & _in_images(live.image_points))
        new = self._new_tracks(self.features - len(live.ids), T_room_camera)
        self._live = _Live(
            **{
                name: np.concatenate([value, getattr(new, name)])
                for name, value in vars(live).items()
            }
        )
        return self._live

    def _project(self, points: Array, T_room_camera: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Image points (n, 3), and which of them are far enough ahead to be seen."""
        T = se3.inverse(T_room_camera)
        points_camera = points @ T[:3, :3].T + T[:3, 3]
        ahead = points_camera[:, 2] > _MIN_DEPTH
        points_camera[~ahead] = [0.0, 0.0, 1.0]
        return self.camera.project(points_camera), ahead

    def _new_tracks(self, count: int, T_room_camera: Array) -> _Live:
        """Begin tracks at random pixels of the left image, where the right one sees them, too."""
        points = self._points_on_walls(8 * count, T_room_camera)
        image_points, ahead = self._project(points, T_room_camera)
        chosen = np.flatnonzero(ahead & _in_images(image_points))[:count]
        n = len(chosen)
        angle = self.rng.uniform(0, 2 * np.pi, n)
        speed = self.rng.uniform(_SLOWEST_SLIDE, _FASTEST_SLIDE, n) / self.rate
        speed *= self.rng.random(n) < self.sliding_share
        across, down = speed * np.cos(angle), 0.3 * speed * np.sin(angle)
        lives = self.rng.exponential(_MEAN_LIFE * self.rate, n) + _SHORTEST_TRACK
        tracks = _Live(
            ids=np.arange(self._ids_given, self._ids_given + n),
            points=points[chosen],
            lives=lives,
            slides=np.column_stack([across, across, down]),
            slid=np.zeros((n, 3)),
            image_points=image_points[chosen],
        )
        self._ids_given += n
        return tracks

    def _points_on_walls(self, count: int, T_room_camera: Array) -> Array:
        """Points (count, 3) of the room where the rays of random pixels meet its walls."""
        pixels = self.rng.uniform(0.0, 1.0, (count, 2)) * [_WIDTH, _HEIGHT]
        principal_point = [self.camera.cx, self.camera.cy]
        rays = np.column_stack([(pixels - principal_point) / self.camera.fx, np.ones(count)])
        direction = rays @ T_room_camera[:3, :3].T
        origin = T_room_camera[:3, 3]
        # A ray leaves a box through the nearest of the three walls that it goes towards.
        with np.errstate(divide="ignore"):
            to_walls = (np.sign(direction) * self.size / 2 - origin) / direction
        return np.asarray(origin + to_walls.min(axis=1)[:, None] * direction)


def _in_images(y: Array) -> NDArray[np.bool_]:
    """Whether image points (n, 3) lie in both images."""
    return np.all((y >= 0) & (y <= [_WIDTH - 1, _WIDTH - 1, _HEIGHT - 1]), axis=1)
