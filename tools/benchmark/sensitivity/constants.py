# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The constants that may decide something, and the values to try in place of each.

Constants of mathematics, of number formats and of units are not here, nor are those that trade
time for digits: sizes of blocks, how often a median is taken anew, how often a search goes round.
"""

import importlib
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings

#: A number, or several that are varied together.
Value: TypeAlias = float | tuple[float, ...]

_SETTINGS = "settings"
_FACTORS = (0.5, 2.0)


@dataclass(frozen=True)
class Constant:
    """A constant of a module, or a setting.

    Attributes
    ----------
    module : str
        Below ``vislam_ros``; ``settings`` for one of RobocentricSettings.
    name : str
    trials : tuple of Value
        What to try; half and double where there is none.
    """

    module: str
    name: str
    trials: tuple[Value, ...] = ()

    @property
    def key(self) -> str:
        """Name of the constant, which is all its own."""
        return f"{self.module}.{self.name}"

    @property
    def is_setting(self) -> bool:
        """Whether a user may set it."""
        return self.module == _SETTINGS

    @property
    def is_of_loading(self) -> bool:
        """Whether it decides how a drive is read, and not how it is estimated."""
        return self.module.startswith("data.")

    @property
    def value(self) -> Value:
        """Value as it stands."""
        holder: Any = (
            RobocentricSettings() if self.is_setting else importlib.import_module(self.path)
        )
        value = getattr(holder, self.name)
        return tuple(np.asarray(value).tolist()) if np.ndim(value) else value

    @property
    def path(self) -> str:
        """Where to import the module from."""
        return f"vislam_ros.{self.module}"

    @property
    def values(self) -> tuple[Value, ...]:
        """What to try."""
        return self.trials or tuple(scaled(self.value, factor) for factor in _FACTORS)


def scaled(value: Value, factor: float) -> Value:
    """Value times a factor; whole numbers stay whole, and at least one."""
    if isinstance(value, tuple):
        return tuple(factor * number for number in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def _of(module: str, *names: str | tuple[str, tuple[Value, ...]]) -> list[Constant]:
    return [
        Constant(module, name) if isinstance(name, str) else Constant(module, *name)
        for name in names
    ]


#: All of them, room by room.
CONSTANTS: tuple[Constant, ...] = (
    *_of(
        "core.noise.track_noise",
        "_MEMORY",
        "_PRIOR_FRAMES",
        "_ENOUGH_ROWS",
        "_LARGEST_CHANGE",
        "_PRIOR_NUMBERS",
        "_STAYS",
        "_FIRST_SHARE",
        "_PRIOR_ERRORS",
        "_ERRORS_REMEMBERED",
        ("_SHARE_OF_OFFSETS", (0.3, 0.5)),
        ("_WHERE_ERRORS_STAY", (1.0, 20.0)),
        ("_WIDER_GATE", (1.0, 3.0)),
        ("_FAR_OFF", (1.0, 3.0)),
        "_RELATIVE_OFFSET",
    ),
    *_of("core.operations.bias_belief", ("_PRIOR_AT_NONE", (0.5, 0.999))),
    *_of(
        "core.noise.motion_noise",
        "_MEMORY",
        "_PRIOR_STEPS",
        "_FIRST_STEPS",
        "_ENOUGH_STEPS",
        "_CONTRADICTED",
        "_FARTHEST",
        "_SMALLEST_NOISE",
        "_SMALLEST_WALK",
    ),
    *_of("core.noise.twist_noise", "_MEMORY", "_PRIOR_WEIGHT", "_PRIOR_FADES"),
    *_of("core.noise.frame_rate", "_DURATIONS"),
    *_of("core.linalg.gating", ("_AS_FAR_OFF", (0.25, 0.9))),
    *_of("core.motion", "FIRST_TWIST_STD"),
    *_of(
        "core.filters.robocentric_model",
        ("_DOUBT", (3.0, 30.0)),
        "_UNFORESEEN",
        "_DRIFT",
        "_SHORTEST_STEP",
    ),
    *_of("core.filters.image_point_map", "_SIGNIFICANT_DISPARITY"),
    *_of("core.geometry.warp", "_MIN_DEPTH_RATIO", "_MAX_RAY_SQUARED"),
    *_of("settings", "rest_after_rejection", "frozen_share", "frozen_motion"),
    *_of(
        "data.datasets.conventions",
        ("CLEARLY_SMALLER", (0.5, 1.0)),
        "MIN_RESIDUALS",
        "_MIN_DEPTH",
    ),
    *_of("data.datasets.step_pairs", "_STEPS_LOOKED_AT", "_MIN_DISPARITY", "_FROZEN_SHARE"),
    *_of(
        "data.datasets.twist_origin",
        "_STEPS_LOOKED_AT",
        "_FEWEST_STEPS",
        "_SMALLEST_DISTANCE",
        "_TELLING",
        "_EVIDENCE",
        "_PIXEL_VARIANCE",
        "_HUBER",
        "_OUTLIER",
        "_LEAST_NOISE",
        "_PRIOR_STD",
    ),
)
