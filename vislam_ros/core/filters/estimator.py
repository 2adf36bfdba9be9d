# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every filter takes and gives."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.columns import Estimate
from vislam_ros.core.motion import Increment, Twist
from vislam_ros.core.settings import SlamSettings, differences, require_live
from vislam_ros.core.tracking.tracked_frame import Keys, TrackedFrame
from vislam_ros.errors import SettingsError

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Pose of the body.

    Attributes
    ----------
    T_world_body : ndarray, (4, 4)
    covariance : ndarray, (6, 6)
        Of the pose error ``[rho; theta]`` on the right.
    """

    T_world_body: Array
    covariance: Array


@dataclass(frozen=True)
class Outcome:
    """What a filter did with one frame, and what it now knows besides pose and map.

    Attributes
    ----------
    used, admitted : int
        Observations that corrected the state, and those that began a landmark.
    rejected : ndarray of int64, (n,)
        Keys of the landmarks whose observation failed a gate; the filter has marginalized them.
    nis : float
        Normalised innovation squared of the used observations together.
    nis_dof : int
        Its degrees of freedom.
    pose : Pose or None
        What to tell of the body's pose, where the filter weighs several models; None where it is
        the filter's own.
    twist : Twist or None
        Of the body over the step; None where the filter has none in its state.
    estimates : tuple of Estimate
        All else that a user may want to see; the same quantities at every step.
    """

    used: int = 0
    admitted: int = 0
    rejected: Keys = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    nis: float = 0.0
    nis_dof: int = 0
    pose: Pose | None = None
    twist: Twist | None = None
    estimates: tuple[Estimate, ...] = ()

    @property
    def agrees_with_most(self) -> bool:
        """Whether more was used than rejected; where not, it is the estimate that is wrong."""
        return len(self.rejected) < self.used

    @property
    def is_contradicted(self) -> bool:
        """Whether observations were rejected, and no fewer than were used."""
        return bool(len(self.rejected)) and not self.agrees_with_most


class Estimator(Protocol):
    """A filter: it takes motions and frames, and can be asked for its estimate."""

    T_world_body: Array
    """Pose (4, 4) of the body in the world."""

    @property
    def pose_covariance(self) -> Array:
        """Covariance (6, 6) of the pose error ``[rho; theta]`` on the right."""

    @property
    def active(self) -> int:
        """Number of landmarks that the next frame can correct."""

    @property
    def landmark_count(self) -> int:
        """Number of landmarks, marginalized ones included."""

    def step(self, increment: Increment, frame: TrackedFrame) -> Outcome:
        """Carry the estimate over a motion, then take the frame seen at its end."""

    def landmarks(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3) of the whole map."""


class Tunable(Protocol):
    """An estimator whose own settings may change while it runs, those that are ``live``."""

    def change_settings(self, settings: Any) -> None:
        """Take settings of its class, from the next step on."""


def tune(estimator: Estimator | None, settings: SlamSettings) -> None:
    """Give a :class:`Tunable` estimator other settings; the others keep theirs."""
    if _is_tunable(estimator):
        cast(Tunable, estimator).change_settings(settings)


def require_possible(
    estimator: Estimator | None, before: SlamSettings, after: SlamSettings
) -> None:
    """Raise a SettingsError where settings differ that cannot be changed in a running session.

    These are what is not live and, once there is an estimator, what is its own where it is not
    :class:`Tunable`. What belongs to every session the session itself follows.
    """
    require_live(before, after)
    for name in differences(before, after):
        own = estimator is not None and not hasattr(SlamSettings, name)
        if own and not _is_tunable(estimator):
            raise SettingsError(
                f"{name}: estimator {after.estimator!r} takes no other value while it runs; give "
                "it a method change_settings"
            )


def _is_tunable(estimator: Estimator | None) -> bool:
    return hasattr(estimator, "change_settings")
