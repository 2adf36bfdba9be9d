# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The mechanisms of the filter, each to be switched off alone."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmark.sensitivity.constants import Constant, Value
from benchmark.sensitivity.varied import varied
from vislam_ros.core.filters import robocentric, robocentric_model
from vislam_ros.core.noise.track_runs import TrackRuns
from vislam_ros.core.operations.bias_belief import BiasBelief, bias_belief


@dataclass(frozen=True)
class Mechanism:
    """A part of the filter, and what switches it off.

    Attributes
    ----------
    settings : mapping
        Settings to change.
    off : callable
        Context in which the mechanism does nothing.
    """

    settings: Mapping[str, Any] = field(default_factory=dict)
    off: Callable[[], AbstractContextManager[Any]] = nullcontext


def _by_constant(module: str, name: str, value: Value) -> Mechanism:
    return Mechanism(off=partial(varied, Constant(f"core.{module}", name), value))


def _no_sum(runs: TrackRuns, indices: NDArray[np.int64], *_: Any) -> NDArray[np.float64]:
    return np.zeros(len(indices))


def _believed(*_: Any) -> robocentric_model.Belied:
    return robocentric_model.Belied()


@contextmanager
def _untempered() -> Iterator[None]:
    def untempered(*given: Any, temper: float) -> BiasBelief:
        return bias_belief(*given, temper=1.0)

    with mock.patch.object(robocentric, "bias_belief", untempered):
        yield


_TRACKS, _MOTION = "noise.track_noise", "noise.motion_noise"
_MODEL, _BELIEF = "filters.robocentric_model", "operations.bias_belief"

#: All of them, by what a table calls them.
MECHANISMS: dict[str, Mechanism] = {
    "learned noise": Mechanism({"learn_noise": False}),
    "noise of each track": _by_constant(_TRACKS, "_PRIOR_NUMBERS", 1e6),
    "heavy tails": _by_constant(_TRACKS, "_FAR_OFF", math.inf),
    "offsets of disparities": Mechanism({"disparity_offset_std": 0.0}),
    "gates": Mechanism({"chi2_gate": 0.0}),
    "wider gate where tracks differ": _by_constant(_TRACKS, "_WIDER_GATE", 1.0),
    "sums of innovations": Mechanism(off=partial(mock.patch.object, TrackRuns, "update", _no_sum)),
    "rest after a rejection": Mechanism({"rest_after_rejection": 0}),
    "frozen frames": Mechanism({"track_continuity": False}),
    "lens": Mechanism({"lens_distortion_std": 0.0}),
    "drift of vision": _by_constant(_MODEL, "_DRIFT", 0.0),
    "bias of the gyroscope": Mechanism({"gyro_bias_std": 0.0}),
    "bias against none": _by_constant(_BELIEF, "_PRIOR_AT_NONE", 0.0),
    "tempered bias": Mechanism(off=_untempered),
    "slow errors of the twist": _by_constant(_MOTION, "_CONTRADICTED", math.inf),
    "images against the twist": Mechanism(
        off=partial(mock.patch.object, robocentric_model, "belied", _believed)
    ),
    "doubt of the twist": _by_constant(_MODEL, "_DOUBT", 1.0),
    "unforeseen changes": _by_constant(_MODEL, "_UNFORESEEN", math.inf),
}


def mechanism_named(name: str | None) -> Mechanism:
    """Return the mechanism of a name; None is none, and changes nothing."""
    return Mechanism() if name is None else MECHANISMS[name]
