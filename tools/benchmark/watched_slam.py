# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A SLAM session that lets others watch what goes into its filter and how long it takes."""

from collections.abc import Callable
from dataclasses import dataclass

from benchmark.interleaving import cpu_clock
from vislam_ros.core.filters.estimator import Estimator, Outcome
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.motion import Increment
from vislam_ros.core.settings import SlamSettings
from vislam_ros.core.slam import Slam
from vislam_ros.core.tracking.tracked_frame import TrackedFrame


@dataclass(frozen=True)
class FilterStep:
    """One step of a filter.

    Attributes
    ----------
    increment : Increment
    frame : TrackedFrame
    outcome : Outcome
    seconds : float
        Time in the filter alone.
    """

    increment: Increment
    frame: TrackedFrame
    outcome: Outcome
    seconds: float


class WatchedSlam(Slam):
    """A session as any other.

    Parameters
    ----------
    settings : SlamSettings
    on_filter_step : callable
        Called with each step of the filter.
    record : bool, optional
        Whether the steps can be smoothed at the end.

    Attributes
    ----------
    filter : Estimator or None
        The one at work.
    """

    def __init__(
        self,
        settings: SlamSettings,
        on_filter_step: Callable[[FilterStep], None],
        *,
        record: bool = False,
    ):
        super().__init__(settings, record=record)
        self._on_filter_step = on_filter_step
        self.filter: Estimator | None = None

    def _new_estimator(self, camera: StereoCamera) -> Estimator:
        self.filter = estimator = super()._new_estimator(camera)
        take_step = estimator.step

        def step(increment: Increment, frame: TrackedFrame) -> Outcome:
            begin = cpu_clock()
            outcome = take_step(increment, frame)
            seconds = cpu_clock() - begin
            self._on_filter_step(FilterStep(increment, frame, outcome, seconds))
            return outcome

        # In place of a wrapper, so that the session sees the filter's own class.
        setattr(estimator, "step", step)  # noqa: B010
        return estimator
