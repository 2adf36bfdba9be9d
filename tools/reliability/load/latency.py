# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long each hop of the graph takes, from what a listener beside it has heard."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.bags.layout import (
    FEATURES,
    LEFT_IMAGE,
    ODOMETRY,
    PREDICTION,
    STEPS,
    TWIST,
    Topic,
)

_NS_A_MS = 1e6

OF_DRIVES = (TWIST, PREDICTION, FEATURES, ODOMETRY, STEPS)
"""What a listener hears of tracks."""

OF_IMAGES = (LEFT_IMAGE, ODOMETRY)
"""What it hears of images, which it would otherwise copy for nothing."""


@dataclass(frozen=True)
class Heard:
    """A message as a listener heard it.

    Attributes
    ----------
    published, came : int
        By the system's clock, ns.
    size : int
        Bytes.
    latency_ms : float
        Of a step, what slam_node says of it; else 0.
    """

    published: int
    came: int
    size: int
    latency_ms: float


Messages = Mapping[str, Mapping[int, Heard]]
"""By topic and by stamp (ns)."""


def parse(lines: Iterable[str]) -> dict[str, dict[int, Heard]]:
    """Messages of a listener's lines."""
    messages: dict[str, dict[int, Heard]] = {topic.name: {} for topic in (*OF_DRIVES, *OF_IMAGES)}
    for line in lines:
        topic, stamp, published, came, size, latency_ms = line.split()
        messages[topic][int(stamp)] = Heard(
            int(published), int(came), int(size), float(latency_ms)
        )
    return messages


@dataclass(frozen=True)
class Percentiles:
    """Of milliseconds."""

    p50: float
    p99: float
    largest: float
    count: int

    @classmethod
    def of(cls, milliseconds: NDArray[np.float64]) -> "Percentiles":
        """Percentiles of some values; NaN of none."""
        if not len(milliseconds):
            return cls(float("nan"), float("nan"), float("nan"), 0)
        p50, p99 = np.percentile(milliseconds, [50.0, 99.0])
        return cls(float(p50), float(p99), float(milliseconds.max()), len(milliseconds))


def whole_latency(messages: Messages, frames: Topic = FEATURES) -> NDArray[np.float64]:
    """Milliseconds from publishing each frame, features or an image, to hearing its odometry."""
    features, odometry = messages[frames.name], messages[ODOMETRY.name]
    return np.array(
        [
            (odometry[stamp].came - features[stamp].published) / _NS_A_MS
            for stamp in sorted(features.keys() & odometry.keys())
        ]
    )


def hops(messages: Messages) -> dict[str, Percentiles]:
    """Percentiles of each hop, by what it is."""
    twists, predictions = messages[TWIST.name], messages[PREDICTION.name]
    features, odometry = messages[FEATURES.name], messages[ODOMETRY.name]
    steps = messages[STEPS.name]
    answered = sorted(features.keys() & odometry.keys() & steps.keys())
    way = [
        # slam_node tells how long ago it took the features when it has published.
        (odometry[s].published - features[s].published) / _NS_A_MS - steps[s].latency_ms
        for s in answered
    ]
    own = [steps[s].latency_ms for s in answered]
    back = [(odometry[s].came - odometry[s].published) / _NS_A_MS for s in answered]
    motion = [
        (predictions[s].published - twists[s].published) / _NS_A_MS
        for s in sorted(twists.keys() & predictions.keys())
    ]
    return {
        "twist published → prediction published": Percentiles.of(np.array(motion)),
        "features published → taken by slam_node": Percentiles.of(np.array(way)),
        "taken by slam_node → odometry published": Percentiles.of(np.array(own)),
        "odometry published → heard": Percentiles.of(np.array(back)),
        "features published → odometry heard": Percentiles.of(whole_latency(messages)),
    }
