# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives that contradict themselves, each in a known way."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from reliability.outages import Outage
from vislam_ros.core.geometry import se3
from vislam_ros.data.drive import Drive

Array = NDArray[np.float64]
Change = Callable[[Drive], Drive]

# Optical axes (right, down, forward) in forward-left-up ones.
_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
_SEED = 7
# Pixels a frame, as simulated tracks slide.
_SLOWEST, _FASTEST = 2.0, 6.0
_AT = 0.4


class Disturbance(NamedTuple):
    """A way to make a drive contradict itself.

    Attributes
    ----------
    change : callable
        Takes a drive and returns the disturbed one.
    named : str
        Part of the reason that names what was done; empty where no reason can.
    """

    change: Change
    named: str = ""


def _with_extrinsics(of: Callable[[Array], Array]) -> Change:
    def change(drive: Drive) -> Drive:
        T = of(drive.camera.T_body_camera)
        x, y, z = T[:3, 3].tolist()
        qx, qy, qz, qw = se3.quaternion_from_rotation(T[:3, :3]).tolist()
        camera = dataclasses.replace(
            drive.camera,
            position_body_camera=(x, y, z),
            quaternion_body_camera=(qx, qy, qz, qw),
        )
        return dataclasses.replace(drive, camera=camera)

    return change


def _with_twists(matrix: Array) -> Change:
    return lambda drive: dataclasses.replace(drive, twists=drive.twists @ matrix.T)


def _scaled(velocity: float = 1.0, angular_velocity: float = 1.0) -> Change:
    return _with_twists(np.diag(np.repeat([velocity, angular_velocity], 3)))


def _with_camera(focal: float = 1.0, baseline: float = 1.0) -> Change:
    def change(drive: Drive) -> Drive:
        camera = drive.camera
        camera = dataclasses.replace(
            camera,
            fx=focal * camera.fx,
            fy=focal * camera.fy,
            fx_baseline=focal * baseline * camera.fx_baseline,
        )
        return dataclasses.replace(drive, camera=camera)

    return change


def _exchanged_sides(drive: Drive) -> Drive:
    return dataclasses.replace(drive, pixels=drive.pixels[:, [2, 3, 0, 1]])


def _late(frames: int) -> Change:
    """Give each twist the stamp of so many frames later; the first ones are missing then."""

    def change(drive: Drive) -> Drive:
        period = int(np.median(np.diff(drive.feature_stamps)))
        stamps = drive.twist_stamps + frames * period
        early = drive.twist_stamps[drive.twist_stamps < stamps[0]]
        return dataclasses.replace(
            drive,
            twist_stamps=np.concatenate([early, stamps]),
            twists=np.concatenate([drive.twists[: len(early)], drive.twists]),
        )

    return change


def _mixed_ids(drive: Drive) -> Drive:
    """Exchange the pixels of each frame among its tracks."""
    rng, pixels = np.random.default_rng(_SEED), drive.pixels.copy()
    for begin, end in zip(drive.offsets[:-1], drive.offsets[1:], strict=True):
        pixels[begin:end] = rng.permutation(pixels[begin:end])
    return dataclasses.replace(drive, pixels=pixels)


def _sliding(share: float) -> Change:
    """Let a share of the tracks slide over the scene; what repeats its pixels goes on to."""

    def change(drive: Drive) -> Drive:
        rng, tracks = np.random.default_rng(_SEED), int(drive.ids.max()) + 1
        angle = rng.uniform(0, 2 * np.pi, tracks)
        rate = rng.uniform(_SLOWEST, _FASTEST, tracks) * (rng.random(tracks) < share)
        across = np.column_stack([np.cos(angle), 0.3 * np.sin(angle)]) * rate[:, None]
        order = np.argsort(drive.ids, kind="stable")
        ids, pixels = drive.ids[order], drive.pixels[order]
        goes_on = ids[1:] == ids[:-1]
        moved = np.concatenate([[False], goes_on & np.any(pixels[1:] != pixels[:-1], axis=1)])
        steps = np.cumsum(moved)
        first = np.maximum.accumulate(
            np.where(np.concatenate([[True], ~goes_on]), np.arange(len(ids)), 0)
        )
        slid = pixels.astype(float)
        slid += np.tile((steps - steps[first])[:, None] * across[ids], 2)
        result = np.empty_like(drive.pixels)
        result[order] = slid.astype(np.float32)
        return dataclasses.replace(drive, pixels=result)

    return change


def _without_features(seconds: float) -> Change:
    return lambda drive: Outage("features", _AT, seconds).applied(drive)


def _turned(degrees: float) -> Array:
    """Motion (4, 4) of a camera that is turned about its vertical axis."""
    return np.asarray(se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(degrees), 0.0])))


def _twists_in(axes: Array) -> Change:
    """Measure the twists in other axes, a turn (4, 4) of the body's."""
    return _with_twists(se3.adjoint(se3.inverse(axes)))


_EXCHANGED_XY = np.eye(6)[[1, 0, 2, 4, 3, 5]]
_ODD = "no other reading"

#: By what they do. Those of the last group leave the estimate as good as it was.
DISTURBANCES: Mapping[str, Disturbance] = {
    "extrinsics inverted": Disturbance(
        _with_extrinsics(se3.inverse), "T_body_camera inverted would"
    ),
    "extrinsics to forward-left-up camera": Disturbance(
        _with_extrinsics(lambda T: T @ se3.inverse(_OPTICAL)), "as to forward-left-up"
    ),
    "the same, inverted": Disturbance(
        _with_extrinsics(lambda T: se3.inverse(T @ se3.inverse(_OPTICAL))), "inverted, as to"
    ),
    "camera turned by 30 degrees": Disturbance(
        _with_extrinsics(lambda T: T @ _turned(30.0)), _ODD
    ),
    "twists forward-right-down": Disturbance(_twists_in(_HALF_TURN), "forward-right-down"),
    "twists in optical axes": Disturbance(_twists_in(_OPTICAL), "optical axes"),
    "x and y of twists exchanged": Disturbance(_with_twists(_EXCHANGED_XY), _ODD),
    "angular velocity negative": Disturbance(_scaled(1.0, -1.0), "angular velocities of the"),
    "velocity negative": Disturbance(_scaled(-1.0), "velocities of the other"),
    "angular velocity in degrees": Disturbance(_scaled(1.0, 180 / np.pi), "angular velocity"),
    "angular velocity x 0.8": Disturbance(_scaled(1.0, 0.8), "the angular velocity"),
    "velocity x 0.5": Disturbance(_scaled(0.5), "the velocity"),
    "velocity x 0.8": Disturbance(_scaled(0.8), "the velocity"),
    "velocity x 1.25": Disturbance(_scaled(1.25), "the velocity"),
    "velocity x 2": Disturbance(_scaled(2.0), "the velocity"),
    "baseline x 0.5": Disturbance(_with_camera(baseline=0.5), "the velocity"),
    "baseline x 2": Disturbance(_with_camera(baseline=2.0), "the velocity"),
    "focal length x 0.8": Disturbance(_with_camera(focal=0.8), "focal length"),
    "focal length x 1.25": Disturbance(_with_camera(focal=1.25), "focal length"),
    "left and right exchanged": Disturbance(_exchanged_sides, "exchanged"),
    "ids mixed": Disturbance(_mixed_ids, "do not move as one"),
    "half of the tracks slide": Disturbance(_sliding(0.5)),
    "no features for 5 s": Disturbance(_without_features(5.0), "vision was missing"),
    "no features for 10 s": Disturbance(_without_features(10.0), "vision was missing"),
    "no features for 30 s": Disturbance(_without_features(30.0), "vision was missing"),
    "no features from the middle on": Disturbance(
        lambda drive: Outage("features", 0.5, 1e6).applied(drive), "vision was missing"
    ),
    "twists 5 frames late": Disturbance(_late(5), "late"),
    "twists 5 frames early": Disturbance(_late(-5), "early"),
    "twists 3 frames late": Disturbance(_late(3), "late"),
    "twists 2 frames early": Disturbance(_late(-2), "early"),
    "twists 1 frame late": Disturbance(_late(1), "late"),
}
