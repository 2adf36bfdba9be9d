# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated stereo images: settings, and frames one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.core.settings import LARGEST_RATE, LARGEST_WHOLE, changed, setting
from vislam_ros.data.simulation.images.imu import ImuSamples, imu_samples
from vislam_ros.data.simulation.images.lens import LensView
from vislam_ros.data.simulation.images.motion import SmoothMotion, Stamps, room_poses
from vislam_ros.data.simulation.images.rigs import room_rig, street_rig
from vislam_ros.data.simulation.images.room import room
from vislam_ros.data.simulation.images.scene import Scene
from vislam_ros.data.simulation.images.sensor import Sensor, exposures
from vislam_ros.data.simulation.images.street import street
from vislam_ros.data.simulation.images.texture import Field, Grey
from vislam_ros.data.simulation.motion import drive_poses
from vislam_ros.data.trajectory import NANOSECONDS, Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]

_FIRST_STAMP = 1_700_000_000 * NANOSECONDS
_KNOT_PERIOD = 0.05  # seconds between the poses that a simulated motion goes through
ACCELEROMETER_NOISE_DENSITY = 2e-3  # m/s^2/sqrt(Hz), as of a small MEMS sensor
# A blurred image is the mean of some that move by about this from one to the next, pixels, which
# is as far as a lens spreads a point; and of no more than so many, for each takes its time.
_EXPOSED_APART, _MOST_EXPOSED = 2.0, 8
# How much brighter the right image is: two sensors of a kind differ by a few per cent.
_RIGHT_GAIN = 1.03


@dataclass(frozen=True)
class ImageSettings:
    """What images are simulated."""

    scene: str = setting("street", "What the cameras look at", choices=("street", "room"))
    seconds: float = setting(20.0, "Duration [s]", minimum=0.1, maximum=3600.0)
    rate: float = setting(20.0, "Stereo frames a second [Hz]", minimum=0.5, maximum=200.0)
    scale: float = setting(
        1.0,
        "Size of the images, in that of the scene's cameras: 640 x 240 in the street, 752 x 480 "
        "in the room",
        minimum=0.1,
        maximum=4.0,
    )
    rectified: bool = setting(
        False, "Draw a rectified pair, without lenses, in place of two raw cameras"
    )
    moving_objects: int = setting(3, "Things that move", minimum=0, maximum=20)
    exposure_changes: bool = setting(
        False, "Let the exposure wander, and err on both sides for a while"
    )
    exposure_time: float = setting(
        0.0, "How long an image is exposed while it moves [s]", minimum=0.0, maximum=0.1
    )
    image_noise: float = setting(
        1.0, "Noise of the images, times that of a small sensor", minimum=0.0, maximum=100.0
    )
    gyro_noise_density: float = setting(
        1.7e-4, "White noise of the gyroscope [rad/s/sqrt(Hz)]", minimum=0.0, maximum=1.0
    )
    gyro_bias: tuple[float, float, float] = setting(
        (0.002, 0.002, 0.002),
        "Constant error of the measured angular velocity [rad/s]",
        minimum=-LARGEST_RATE,
        maximum=LARGEST_RATE,
    )
    velocity_noise_std: float = setting(
        0.1,
        "White noise of the velocity of one frame's twist on each axis [m/s]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    angular_velocity_noise_std: float = setting(
        0.01,
        "White noise of the angular velocity of one frame's twist on each axis [rad/s]",
        minimum=0.0,
        maximum=LARGEST_RATE,
    )
    seed: int = setting(0, "Seed of everything random", minimum=0, maximum=LARGEST_WHOLE)


@dataclass(frozen=True)
class SimulatedImages:
    """Stereo images that are drawn when they are asked for, and the truth about them.

    Attributes
    ----------
    settings : ImageSettings
    rig : StereoRig
    stamps : ndarray of int64, (n,)
        Of the frames, at the middle of their exposure, nanoseconds.
    motion : SmoothMotion
    imu : ImuSamples
    twists : ndarray, (n, 6)
        Measured twists ``[v; omega]`` of the body over the step to each frame.
    scene : Scene
    exposures : ndarray, (n,)
        Of each frame; 1 shows the scene as it is.
    """

    settings: ImageSettings
    rig: StereoRig
    stamps: Stamps
    motion: SmoothMotion
    imu: ImuSamples
    twists: Array
    scene: Scene
    exposures: Array
    _views: tuple[LensView, LensView]
    _sensor: Sensor

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def trajectory(self) -> Trajectory:
        """True poses of the body at the frames."""
        return Trajectory.from_matrices(self.stamps, self.motion.poses(self.stamps))

    def frame(self, k: int) -> tuple[Grey, Grey]:
        """Draw the left and the right image (height, width) of frame k, in any order of frames."""
        begins = self._exposed(k)
        T_world_body = self.motion.poses(begins)
        sums: list[Field] = []
        for T, stamp in zip(T_world_body, begins, strict=True):
            surfaces = self.scene.at((int(stamp) - self.motion.first) / NANOSECONDS)
            T_world_left = T @ self.rig.T_body_left
            for side, T_world_camera in enumerate(
                (T_world_left, T_world_left @ self.rig.T_left_right)
            ):
                drawn = self._views[side].draw(T_world_camera, surfaces, self.scene.empty)
                if len(sums) <= side:
                    sums.append(drawn.astype(np.float32))
                else:
                    sums[side] += drawn
        images = []
        for side, radiance in enumerate(sums):
            rng = np.random.default_rng([self.settings.seed, k, side])
            gain = float(self.exposures[k]) * (_RIGHT_GAIN if side else 1.0) / len(begins)
            images.append(self._sensor.image(radiance, gain, rng))
        return images[0], images[1]

    def frames(self) -> Iterator[tuple[int, Grey, Grey]]:
        """Stamp, left and right image of each frame in turn."""
        for k, stamp in enumerate(self.stamps.tolist()):
            yield stamp, *self.frame(k)

    def _exposed(self, k: int) -> Stamps:
        """Times (m,) within the exposure of frame k, evenly about its stamp."""
        half = round(self.settings.exposure_time * NANOSECONDS / 2)
        stamp = int(self.stamps[k])
        bounds = np.clip([stamp - half, stamp + half], self.motion.first, self.motion.last)
        if half == 0:
            return self.stamps[k : k + 1]
        before, after = self.motion.poses(bounds)
        angle = float(np.linalg.norm(se3.log_rotation(before[:3, :3].T @ after[:3, :3])))
        way = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
        # What is as near as ten baselines moves by its share of the focal length.
        near = 10 * float(np.linalg.norm(self.rig.T_left_right[:3, 3]))
        flow = float(self.rig.left.K[0, 0]) * (angle + way / near)
        count = min(max(int(np.ceil(flow / _EXPOSED_APART)), 2), _MOST_EXPOSED)
        shares = (np.arange(count) + 0.5) / count
        return np.rint(bounds[0] + shares * (bounds[1] - bounds[0])).astype(np.int64)


def simulate_images(
    settings: ImageSettings | None = None, along: Trajectory | None = None, **values: Any
) -> SimulatedImages:
    """Simulate stereo images; equal settings give equal images, to the last bit.

    Parameters
    ----------
    settings : ImageSettings, optional
    along : Trajectory, optional
        A recorded motion of a body (x forward, the world's z up), taken from its begin in place of
        the simulated one. It ends where the record does.
    **values
        Settings by name that are put over these, such as ``scene="room"``.

    Raises
    ------
    VislamError
        Where a setting is out of its range, or ``along`` is shorter than two frames.
    """
    settings = changed(settings or ImageSettings(), **values)
    motion_rng, scene_rng, exposure_rng, imu_rng, twist_rng = map(
        np.random.default_rng, np.random.SeedSequence(settings.seed).spawn(5)
    )
    motion = _motion(settings, motion_rng) if along is None else _recorded(along, settings)
    period = NANOSECONDS / settings.rate
    count = int(min(settings.seconds * NANOSECONDS, motion.last - motion.first) / period) + 1
    if count < 2:
        raise VislamError(
            f"along: a motion of {(motion.last - motion.first) / NANOSECONDS:g} s has no two "
            f"frames at {settings.rate:g} Hz: take a longer one, or a higher rate"
        )
    stamps = motion.first + np.rint(period * np.arange(count)).astype(np.int64)
    seconds = (stamps - motion.first) / NANOSECONDS
    T_world_body = motion.poses(stamps)

    if settings.scene == "street":
        rig = street_rig(settings.scale, rectified=settings.rectified)
        scene = street(T_world_body, seconds, moving=settings.moving_objects, rng=scene_rng)
    else:
        rig = room_rig(settings.scale, rectified=settings.rectified)
        scene = room(T_world_body, moving=settings.moving_objects, rng=scene_rng)
    return SimulatedImages(
        settings=settings,
        rig=rig,
        stamps=stamps,
        motion=motion,
        imu=imu_samples(
            motion,
            gyro_noise_density=settings.gyro_noise_density,
            gyro_bias=settings.gyro_bias,
            accelerometer_noise_density=ACCELEROMETER_NOISE_DENSITY,
            rng=imu_rng,
        ),
        twists=_twists(stamps, T_world_body, settings, twist_rng),
        scene=scene,
        exposures=(
            exposures(seconds, exposure_rng) if settings.exposure_changes else np.ones(count)
        ),
        _views=(LensView(rig.left), LensView(rig.right)),
        _sensor=Sensor(rig.left.image_size, settings.image_noise),
    )


def _motion(settings: ImageSettings, rng: np.random.Generator) -> SmoothMotion:
    knots = int(np.ceil(settings.seconds / _KNOT_PERIOD)) + 2
    seconds = _KNOT_PERIOD * np.arange(knots, dtype=np.float64)
    if settings.scene == "street":
        T_world_body = drive_poses(knots, _KNOT_PERIOD, rng)
    else:
        T_world_body = room_poses(seconds, rng)
    stamps = _FIRST_STAMP + np.rint(seconds * NANOSECONDS).astype(np.int64)
    return SmoothMotion(stamps, T_world_body)


def _recorded(along: Trajectory, settings: ImageSettings) -> SmoothMotion:
    last = int(along.stamps[0]) + round((settings.seconds + 1.0) * NANOSECONDS)
    count = int(np.searchsorted(along.stamps, last))
    if count < 2:
        raise VislamError("along: a motion of one pose within the time: take a longer one")
    return SmoothMotion(along.stamps[:count], along.T_world_body[:count])


def _twists(
    stamps: Stamps, T_world_body: Array, settings: ImageSettings, rng: np.random.Generator
) -> Array:
    """Measured twists (n, 6); that of the first frame is the second's but for noise."""
    tau = np.diff(stamps) / NANOSECONDS
    twists = se3.log(se3.inverse(T_world_body[:-1]) @ T_world_body[1:]) / tau[:, None]
    std = np.repeat([settings.velocity_noise_std, settings.angular_velocity_noise_std], 3)
    true = np.concatenate([twists[:1], twists])
    bias = np.array([0.0, 0.0, 0.0, *settings.gyro_bias])
    return true + bias + std * rng.standard_normal(true.shape)
