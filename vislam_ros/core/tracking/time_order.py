# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The order of a stream's stamps: forward, back by a little, or back by a jump."""

import enum


class Refusal(enum.Enum):
    """Why a message was not used."""

    LATE = "late"
    DUPLICATE = "duplicate"
    NON_FINITE = "non_finite"
    WRONG_SIZE = "wrong_size"
    NOT_A_ROTATION = "not_a_rotation"
    DUPLICATE_IDS = "duplicate_ids"
    NO_PREDICTION = "no_prediction"
    QUEUE_FULL = "queue_full"


class TimeOrder:
    """Watches one stream's stamps.

    Parameters
    ----------
    time_jump : float
        Seconds that a stamp must lie back to count as a new pass and not as late.
    """

    def __init__(self, time_jump: float):
        self._time_jump = round(time_jump * 1e9)
        self._last: int | None = None

    def is_jump(self, stamp: int) -> bool:
        """Tell whether a stamp (ns) lies so far back that time began anew."""
        return self._last is not None and stamp < self._last - self._time_jump

    def refusal(self, stamp: int) -> Refusal | None:
        """Reason to refuse a stamp (ns) that is no jump, or None."""
        if self._last is None or stamp > self._last or self.is_jump(stamp):
            return None
        return Refusal.DUPLICATE if stamp == self._last else Refusal.LATE

    def accept(self, stamp: int) -> None:
        """Take a stamp (ns) as the latest."""
        self._last = stamp

    def reset(self) -> None:
        """Forget the past."""
        self._last = None
