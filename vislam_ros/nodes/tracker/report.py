# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stereo_tracker_node says of its work on /diagnostics."""

import numpy as np

from vislam_ros.data.results.summary import peak_rss_mb
from vislam_ros.frontend.tracker import Tracked


class TrackerReport:
    """Gathers pairs for /diagnostics.

    Attributes
    ----------
    published : int
        Feature frames that were published.
    """

    def __init__(self) -> None:
        self.published = 0
        self._pairs = self._repeated = self._observed = 0
        self._ms: list[float] = []

    def add(self, tracked: Tracked, latency_ms: float) -> None:
        """Note a pair, and how long it took from when its later image came."""
        self._pairs += 1
        self._repeated += tracked.repeated
        self.published += not tracked.repeated
        self._observed = len(tracked.ids)
        self._ms.append(latency_ms)

    def values(self) -> dict[str, object]:
        """Values since the last call and in all."""
        ms, self._ms = np.array(self._ms), []
        values: dict[str, object] = {
            "pairs": self._pairs,
            "repeated pairs": self._repeated,
            "features published": self.published,
            "peak memory [MB]": peak_rss_mb() or 0.0,
        }
        if len(ms):
            values["observed"] = self._observed
            values["pair mean [ms]"] = float(ms.mean())
            values["pair max [ms]"] = float(ms.max())
        return values
