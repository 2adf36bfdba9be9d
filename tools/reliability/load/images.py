# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam run`` on stereo images in real time, with a listener beside it."""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from reliability.load.graph import local_environment
from reliability.load.latency import Percentiles, whole_latency
from reliability.load.listener import IMAGES
from reliability.load.listening import listening
from vislam_ros.cli.exit_codes import OK
from vislam_ros.data.bags.layout import LEFT_IMAGE, ODOMETRY
from vislam_ros.data.results.summary import read_summary
from vislam_ros.errors import VislamError

_LONGEST = 600.0


@dataclass(frozen=True)
class ImageLatency:
    """What became of stereo pairs.

    Attributes
    ----------
    heard, answered : int
        Left images and odometries that the listener heard.
    complete : bool
        Whether the recorder has a pose for each features message, and all is there.
    steps : int
    whole, settled : Percentiles
        Milliseconds from publishing a left image to hearing its odometry: of all pairs, and of
        those after the first second, in which processes begin.
    """

    heard: int
    answered: int
    complete: bool
    steps: int
    whole: Percentiles
    settled: Percentiles


def measure_images(images: Path, out: Path) -> ImageLatency:
    """Run images in real time.

    Raises
    ------
    VislamError
        Where the run or the listener fails.
    """
    with (
        local_environment() as environment,
        listening(environment, IMAGES) as listener,
    ):
        _run(images, out, environment)
        messages = listener.end()
    sent, odometry = messages[LEFT_IMAGE.name], messages[ODOMETRY.name]
    begin = min(sent, default=0) + 10**9
    later = {name: {s: m for s, m in by.items() if s >= begin} for name, by in messages.items()}
    summary = read_summary(out / "summary.json")
    return ImageLatency(
        len(sent),
        len(odometry),
        bool(summary["complete"]),
        int(summary["steps"]),
        Percentiles.of(whole_latency(messages, LEFT_IMAGE)),
        Percentiles.of(whole_latency(later, LEFT_IMAGE)),
    )


def _run(images: Path, out: Path, environment: Mapping[str, str]) -> None:
    words = ["run", str(images), "--out", str(out), "--no-pictures"]
    command = [sys.executable, "-m", "vislam_ros.cli.main", *words]
    ended = subprocess.run(
        command, env=dict(environment), capture_output=True, text=True, timeout=_LONGEST
    )
    if ended.returncode != OK:
        raise VislamError(f"vislam run: {ended.stderr.strip().splitlines()[-1]}")
