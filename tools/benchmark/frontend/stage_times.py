# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each stage of the front end costs, beside bare OpenCV calls on the same images.

The floor is what OpenCV alone takes for the usual recipe: pyramidal Lucas and Kanade forward and
back, corners, the fundamental matrix, and Lucas and Kanade to the right image and back. OpenCV
has one thread, as everything here.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np

from benchmark.frontend.image_sets import Grey, ImageSet
from benchmark.frontend.track_quality import quality
from benchmark.interleaving import cpu_clock
from vislam_ros.frontend import tracker as tracker_module
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.tracker import StereoTracker, Tracked

Row = dict[str, Any]

#: Stage -> what it is called in the tracker.
_STAGES = {
    "is it repeated?": "is_repeated",
    "Lucas and Kanade, forward and back": "follow",
    "camera's motion": "camera_motion",
    "where it takes points": "moved",
    "cutting patches": "cut_patches",
    "placing patches, in time and in the other image": "place",
    "corners": "new_corners",
    "search along rows": "row_search",
    "noise": "stated_noise",
}
_OTHER = "tables of points"


def measure_frontend(sets: list[ImageSet], repeats: int) -> dict[str, list[Row]]:
    """Measure all image sets; medians over frames, and over repeats."""
    with _one_thread():
        rows, stages = [], []
        for images in sets:
            own = [_run(images) for _ in range(repeats)]
            tracked, times = own[0][0], [run[1] for run in own]
            floor = float(np.median([_usual_recipe(images) for _ in range(repeats)])) * 1e3
            total = float(np.median([np.median([sum(f.values()) for f in run]) for run in times]))
            rows.append(
                {
                    "name": images.name,
                    "size": "{} x {}".format(*images.size),
                    "features": images.features,
                    **quality(images.camera, tracked),
                    "frame_ms": total * 1e3,
                    "floor_ms": floor,
                    "ratio": total * 1e3 / floor,
                }
            )
            for stage in (*_STAGES, _OTHER):
                took = np.median([np.median([f[stage] for f in run]) for run in times])
                stages.append(
                    {
                        "images": images.name,
                        "name": stage,
                        "frame_ms": float(took) * 1e3,
                        "share": float(took) / total,
                    }
                )
    return {"frontend": rows, "frontend_stages": stages}


def _run(images: ImageSet) -> tuple[list[Tracked], list[dict[str, float]]]:
    """Tracks of a set, and the seconds of each stage of each frame but the first."""
    settings = TrackerSettings(max_features=images.features)
    tracker = StereoTracker(images.camera, images.size, settings)
    spent: dict[str, float] = defaultdict(float)
    tracked, frames = [], []
    with _timed_stages(spent):
        for pair, R in zip(images.pairs, images.rotations, strict=True):
            spent.clear()
            start = cpu_clock()
            tracked.append(tracker.track(*pair, R))
            spent[_OTHER] = cpu_clock() - start - sum(spent.values())
            frames.append(defaultdict(float, spent))
    return tracked, list(frames[1:])


@contextmanager
def _timed_stages(spent: dict[str, float]) -> Iterator[None]:
    """Add the seconds of each stage to a table, for a while."""
    originals = {name: getattr(tracker_module, name) for name in _STAGES.values()}

    def timed(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            start = cpu_clock()
            try:
                return function(*arguments)
            finally:
                spent[stage] += cpu_clock() - start

        return run

    try:
        for stage, name in _STAGES.items():
            setattr(tracker_module, name, timed(stage, originals[name]))
        yield
    finally:
        for name, function in originals.items():
            setattr(tracker_module, name, function)


@contextmanager
def _one_thread() -> Iterator[None]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _usual_recipe(images: ImageSet) -> float:
    """Median of the seconds a frame that OpenCV takes for as many points."""

    def flow(before: Grey, now: Grey, points: Any, guess: Any) -> Any:
        found: Any = cv2.calcOpticalFlowPyrLK(
            before,
            now,
            points,
            guess.copy(),
            winSize=(15, 15),
            maxLevel=3,
            criteria=(3, 20, 0.02),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        return found[0]

    seconds = []
    for (before, _), (left, right) in zip(images.pairs, images.pairs[1:], strict=False):
        points: Any = cv2.goodFeaturesToTrack(before, images.features, 0.002, 15)
        start = cpu_clock()
        now = flow(before, left, points, points)
        flow(left, before, now, points)
        cv2.findFundamentalMat(points, now, cv2.USAC_MAGSAC, 1.0, 0.999, 1000)
        cv2.goodFeaturesToTrack(left, images.features, 0.002, 15)
        there = flow(left, right, points, points)
        flow(right, left, there, points)
        seconds.append(cpu_clock() - start)
    return float(np.median(seconds))
