# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the estimators: one frozen dataclass each, described where they are declared.

The nodes declare their ROS parameters from these fields, and ``vislam solve`` reads them from
the same YAML, so a name, a range and a meaning are written once.
"""

import dataclasses
import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from vislam_ros.core.ranges import LARGEST_PIXEL, VELOCITY
from vislam_ros.errors import SettingsError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


# Settings beyond these are slips of a digit or of a unit, and their squares soon no numbers.
#: Of a velocity, an angular velocity, their noise and their walks [m/s, rad/s, m/s/sqrt(s)].
LARGEST_RATE = VELOCITY.high
#: "Not known at all", of a pose or a landmark [m^2, rad^2].
LARGEST_VARIANCE = 1e12
#: A day and a night of frames [frames, s].
MOST_FRAMES, LONGEST_TIME = 1_000_000, 1e6
#: Squared, in standard deviations.
LARGEST_GATE = 1e12
#: ROS has no larger ones.
LARGEST_WHOLE = 2**63 - 1

#: Of the prediction: twists, a gyroscope alone, or what there is.
MOTION_SOURCES = ("auto", "twist", "gyro")


def setting(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
) -> Any:
    """Declare a dataclass field with its meaning (unit in brackets) and its range.

    One that is ``live`` may change while a session runs; the others hold from its start.
    """
    return dataclasses.field(
        default=default,
        metadata={
            "description": description,
            "minimum": minimum,
            "maximum": maximum,
            "choices": choices,
            "live": live,
        },
    )


@dataclass(frozen=True)
class MotionSettings:
    """Noise of the motion and the order of time, shared by the prediction and the filters."""

    process_noise: str = setting(
        "white_twist",
        "How the covariance W of a step of tau seconds is made: white_twist takes (sigma tau)^2 "
        "from the two noise levels below, constant takes process_variance for every step",
        choices=("white_twist", "constant"),
    )
    velocity_noise_std: float = setting(
        0.5,
        "White noise of one velocity sample on each axis [m/s], with process_noise: white_twist",
        minimum=0.0,
        maximum=LARGEST_RATE,
        live=True,
    )
    angular_velocity_noise_std: float = setting(
        0.05,
        "White noise of one angular velocity sample on each axis [rad/s], with process_noise: "
        "white_twist",
        minimum=0.0,
        maximum=LARGEST_RATE,
        live=True,
    )
    process_variance: float = setting(
        1e-10,
        "Variance of each of the six pose terms in a step [m^2, rad^2], with process_noise: "
        "constant",
        minimum=0.0,
        maximum=LARGEST_VARIANCE,
        live=True,
    )
    prior_pose_variance: float = setting(
        0.0,
        "Variance of each of the six terms of the first pose [m^2, rad^2]; 0 makes the first "
        "pose the map's origin",
        minimum=0.0,
        maximum=LARGEST_VARIANCE,
    )
    time_jump: float = setting(
        1.0,
        "A stamp that lies more than this from the newest is believed only with the next message "
        "near it: ahead after a hole, back as the begin of a new pass; a smaller step back is a "
        "late message: refused live, sorted in offline [s]",
        minimum=0.0,
        maximum=LONGEST_TIME,
    )


@dataclass(frozen=True)
class PredictionSettings(MotionSettings):
    """Settings of the dead reckoning."""

    motion_source: str = setting(
        "auto",
        "What measures the motion: twist takes velocity and angular velocity, gyro the angular "
        "velocity of every imu/data sample alone, auto the twists where there are some",
        choices=MOTION_SOURCES,
    )


@dataclass(frozen=True)
class SlamSettings(MotionSettings):
    """Settings of every SLAM session; those of an estimator of its own are a class of these."""

    estimator: str = setting("robocentric", "Which filter runs, or module:Class of your own")
    retire_after: int = setting(
        1,
        "A landmark unseen for this many feature frames, missing ones included, leaves the dense "
        "block and its track",
        minimum=1,
        maximum=MOST_FRAMES,
        live=True,
    )
    rest_after_rejection: int = setting(
        20,
        "Feature frames for which a track whose observation was rejected is left out",
        minimum=0,
        maximum=MOST_FRAMES,
        live=True,
    )
    track_continuity: bool = setting(
        True,
        "Find frozen frames, which repeat the last pixels while the body moves, and begin the "
        "repeated tracks anew",
        live=True,
    )
    frozen_share: float = setting(
        0.5,
        "A frame is frozen when more than this share of its common tracks repeat their pixels "
        "to the last bit",
        minimum=0.0,
        maximum=1.0,
        live=True,
    )
    frozen_motion: float = setting(
        0.1,
        "Tracks that the predicted motion moves by less than this (median of a frame) may "
        "repeat their pixels honestly, as those of a standing car do [px]",
        minimum=0.0,
        maximum=LARGEST_PIXEL,
        live=True,
    )
    feature_fraction: float = setting(
        1.0,
        "Share of the tracks that are used, chosen by a hash of id and seed",
        minimum=0.0,
        maximum=1.0,
    )
    seed: int = setting(0, "Seed of the choice of tracks", minimum=0, maximum=LARGEST_WHOLE)
    max_active: int = setting(
        500,
        "Tracks that are followed at a time. Where a frame has more, those are taken that cover "
        "the image best, and the others are left out, counted and told: a step of robocentric "
        "and joint costs the cube of their number",
        minimum=1,
        maximum=20_000,
        live=True,
    )
    max_pending: int = setting(
        5000,
        "Feature frames that may wait for their prediction or the camera; more are refused. One "
        "of thousands of features counts as so many",
        minimum=1,
        maximum=MOST_FRAMES,
    )


S = TypeVar("S", bound="DataclassInstance")


def settings_from_dict(cls: type[S], values: Mapping[str, Any]) -> S:
    """Build settings from names and values, checking type and range of each.

    Raises
    ------
    SettingsError
        Naming the field, the value and what is allowed.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for name in values:
        if name not in fields:
            raise SettingsError(f"{name}: no such parameter{nearest_name(name, fields)}")
    checked = {name: _checked(fields[name], value) for name, value in values.items()}
    return cls(**checked)


def changed(settings: S, **values: Any) -> S:
    """Put values by name over settings, checked as :func:`settings_from_dict` does."""
    return settings_from_dict(type(settings), {**dataclasses.asdict(settings), **values})


def is_live(field: "dataclasses.Field[Any]") -> bool:
    """Whether a setting may change while a session runs."""
    return bool(field.metadata.get("live", False))


def differences(before: S, after: S) -> dict[str, tuple[Any, Any]]:
    """Settings that differ, by name: their value before and after."""
    return {
        field.name: (getattr(before, field.name), getattr(after, field.name))
        for field in dataclasses.fields(before)
        if getattr(before, field.name) != getattr(after, field.name)
    }


def require_live(before: S, after: S) -> None:
    """Raise a SettingsError where settings differ that hold from the start of a session."""
    live = {field.name for field in dataclasses.fields(before) if is_live(field)}
    for name, (_, value) in differences(before, after).items():
        if name not in live:
            raise SettingsError(
                f"{name}: {value!r} cannot be set while the estimate runs; start it with that"
            )


def nearest_name(name: str, declared: Iterable[str]) -> str:
    """Hint at the declared name that is most like a wrong one, if there is any."""
    nearest = difflib.get_close_matches(name, list(declared), n=1)
    return f"; did you mean {nearest[0]}?" if nearest else ""


def _checked(field: "dataclasses.Field[Any]", value: Any) -> Any:
    """Value of a field in the type of its default, or a SettingsError."""
    default, metadata = field.default, field.metadata
    wanted = type(default).__name__
    if isinstance(default, tuple):
        if not isinstance(value, (list, tuple)) or len(value) != len(default):
            raise SettingsError(f"{field.name}: {value!r} is not a list of {len(default)} numbers")
        result: Any = tuple(_number(field.name, item) for item in value)
        numbers = result
    elif isinstance(default, bool):
        if not isinstance(value, bool):
            raise SettingsError(f"{field.name}: {value!r} is not true or false")
        return value
    elif isinstance(default, float):
        result = _number(field.name, value)
        numbers = (result,)
    elif isinstance(default, int):
        if isinstance(value, bool) or not isinstance(value, int):
            raise SettingsError(f"{field.name}: {value!r} is not a whole number")
        result, numbers = value, (value,)
    else:
        if not isinstance(value, str):
            raise SettingsError(f"{field.name}: {value!r} is not a {wanted}")
        choices = metadata.get("choices")
        if choices and value not in choices:
            raise SettingsError(f"{field.name}: {value!r} is none of {', '.join(choices)}")
        return value
    low, high = metadata.get("minimum"), metadata.get("maximum")
    for number in numbers:
        if (low is not None and number < low) or (high is not None and number > high):
            allowed = f"at least {low}" if high is None else f"between {low} and {high}"
            raise SettingsError(f"{field.name}: {number!r} is out of range; it must be {allowed}")
    return result


def _number(name: str, value: Any) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError
        number = float(value)
        if not math.isfinite(number):
            raise ValueError
    except (ValueError, OverflowError):
        raise SettingsError(f"{name}: {value!r} is not a finite number") from None
    return number
