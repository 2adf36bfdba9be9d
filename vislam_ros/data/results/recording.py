# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result directories of a live run: one for each pass over the data.

See :func:`vislam_ros.data.results.writer.pass_directory`.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.core.step import Row
from vislam_ros.core.verdict.reason import Judgement
from vislam_ros.data.bags.encoding import without_padding
from vislam_ros.data.bags.layout import Topic
from vislam_ros.data.results.message_log import MessageLog
from vislam_ros.data.results.prediction_passes import PredictionPasses
from vislam_ros.data.results.scene import Made, Scene
from vislam_ros.data.results.writer import ResultWriter, note_on_passes, pass_directory

#: Why a run is incomplete whose player was told to end.
PLAYER_INTERRUPTED = "the player was interrupted"
#: How the reason begins why one is whose recorder was.
STOPPED = "the recorder was stopped"

# What CDR begins with, and the stamp that all latched messages have first [bytes].
_AFTER_STAMP = 12


def map_patience(steps: int) -> float:
    """Seconds to wait for the map after so many steps: the way back over the drive takes some.

    Who waits for a recording to end must wait longer (see cli.commands.run).
    """
    return 60.0 + 0.03 * steps


@dataclass(frozen=True)
class Raw:
    """A serialised message as it came.

    Attributes
    ----------
    topic : Topic
    data : bytes
        CDR.
    """

    topic: Topic
    data: bytes


@dataclass(frozen=True)
class Pose:
    """A pose as a message gave it.

    Attributes
    ----------
    stamp : int
        Nanoseconds.
    position, quaternion : ndarray, (3,), (4,)
        Metres; x, y, z, w.
    raw : Raw
    parent, child : str
        Frames between which it is.
    """

    stamp: int
    position: NDArray[Any]
    quaternion: NDArray[Any]
    raw: Raw
    parent: str
    child: str


class _Pass:
    """One result directory that is being written."""

    def __init__(self, directory: Path, *, force: bool, record_mcap: bool):
        self.writer = ResultWriter(directory, force=force)
        self.log = MessageLog(directory / "results.mcap") if record_mcap else None
        self.time_pass = 0
        self.begin: int | None = None  # where the estimate was reset [ns]
        self.steps = 0
        self.last_stamp: int | None = None
        self.map_stamp: int | None = None
        self.finished = False
        # By node, of parameters that were changed: their value when the pass began.
        self.began_with: dict[str, dict[str, Any]] = {}
        self._early: list[Raw] = []
        self._scene = Scene()

    @property
    def map_patience(self) -> float:
        """Seconds to wait for the map of the last step: the way back over the drive takes some."""
        return map_patience(self.steps)

    @property
    def has_final_map(self) -> bool:
        """Whether the map is the one of the last step."""
        return self.map_stamp is not None and self.map_stamp == self.last_stamp

    def takes_prediction(self, time_pass: int, stamp: int) -> bool:
        """Whether a predicted pose at a stamp (ns) of a time pass belongs here and can come."""
        has_begun = self.begin is None or stamp >= self.begin
        return time_pass == self.time_pass and has_begun and not self.finished

    @property
    def has_final_verdict(self) -> bool:
        """Whether the verdict is the one on all steps."""
        verdict = self.writer.summary.verdict
        return verdict is not None and verdict.stamp == self.last_stamp

    def write_raw(self, raw: Raw, stamp: int | None = None) -> None:
        """Log a message; one without a stamp (ns) of the data stands at the latest step."""
        stamp = self.last_stamp if stamp is None else stamp
        if self.log is None:
            return
        if stamp is None:
            self._early.append(raw)
            return
        early, self._early = self._early, []
        for message in (*early, raw):
            self.log.write(message.topic, message.data, stamp)

    def write_step(self, pose: Pose, raw_row: Raw) -> None:
        """Log a step, and what it adds to the scene."""
        self.write_raw(pose.raw, pose.stamp)
        self.write_raw(raw_row, pose.stamp)
        self._write_made(self._scene.add_step, pose)

    def write_prediction(self, pose: Pose) -> None:
        """Write a predicted pose, and log it and what it adds to the scene."""
        self.writer.add_dead_reckoning(pose.stamp, pose.position, pose.quaternion)
        self.write_raw(pose.raw, pose.stamp)
        self._write_made(self._scene.add_prediction, pose)

    def _write_made(self, add: Callable[..., Iterable[Made]], pose: Pose) -> None:
        if self.log is not None:
            frames = pose.parent, pose.child
            for made in add(pose.stamp, pose.position, pose.quaternion, *frames):
                self.log.write(made.topic, made.data, made.stamp)

    def refresh(self) -> None:
        """Bring the files up to date if they are a second old."""
        if not self.finished:
            self.writer.refresh()
            if self.log is not None:
                self.log.refresh()

    def finish(self, *, complete: bool, reason: str | None) -> None:
        """Close all files."""
        if self.finished:
            return
        self.finished = True
        try:
            if self.log is not None:
                for made in self._scene.finish():
                    self.log.write(made.topic, made.data, made.stamp)
                self.log.close()
        finally:
            self.writer.summary.judge_lost_frames()
            self.writer.finish(complete=complete, incomplete_reason=reason)


class Recording:
    """Writes what the recorder hears; a thin layer over the result directories.

    Parameters
    ----------
    directory : Path
    force : bool
        Take a directory that holds an earlier run.
    record_mcap : bool
        Write ``results.mcap`` too.

    Raises
    ------
    VislamError
        Where the directory is in use.
    OutputError
        From any method, where a file cannot be written.
    """

    def __init__(self, directory: Path, *, force: bool, record_mcap: bool):
        self._directory = directory
        self._force = force
        self._record_mcap = record_mcap
        self._count = 1
        self._parameters: Mapping[str, Mapping[str, Any]] = {}
        self._changed: dict[str, dict[str, Any]] = {}  # by node, to their present value
        self._latched: dict[Topic, Raw] = {}
        self._early: deque[_Pass] = deque(maxlen=2)  # passes that were over before these
        self._predictions: PredictionPasses[Pose] = PredictionPasses()
        self._previous: _Pass | None = None
        self._previous_until, self._previous_jumped = 0.0, False
        self._current = _Pass(directory, force=force, record_mcap=record_mcap)

    @property
    def directory(self) -> Path:
        """Directory of the present pass."""
        return self._current.writer.directory

    @property
    def note_on_passes(self) -> str | None:
        """Line that says where the other passes are, if there are any."""
        return note_on_passes(self._directory)

    @property
    def finished(self) -> bool:
        """Whether the present pass is over and its files are closed."""
        return self._current.finished

    @property
    def last_stamp(self) -> int | None:
        """Stamp (ns) of the last step of the present pass."""
        return self._current.last_stamp

    @property
    def map_patience(self) -> float:
        """Seconds to wait for the map of the last step."""
        return self._current.map_patience

    @property
    def has_final_map(self) -> bool:
        """Whether the map of the last step is here."""
        return self._current.has_final_map

    def add_step(
        self,
        pose: Pose,
        covariance_body: NDArray[Any],
        row: Row,
        raw_row: Raw,
        *,
        latency_ms: float,
    ) -> None:
        """Add a step: pose, its (6, 6) covariance in body axes, and its numbers by column."""
        last = self._current.last_stamp
        jumped = last is not None and pose.stamp <= last
        if self._current.finished or jumped or (row["first_of_pass"] and last is not None):
            self._begin_pass(pose.stamp, jumped=jumped)
        current = self._current
        current.steps += 1
        current.last_stamp = pose.stamp
        self._write_predictions(pose.stamp)
        current.writer.add_step(pose.position, pose.quaternion, covariance_body, row)
        current.writer.summary.latencies_ms.append(latency_ms)
        current.write_step(pose, raw_row)

    def add_prediction(self, pose: Pose) -> None:
        """Add a predicted pose, to the pass that its stamp belongs to."""
        self._predictions.enter(pose.stamp, pose)
        last = self._current.last_stamp
        self._write_predictions(-math.inf if last is None else last)

    def _write_predictions(self, until: float = math.inf) -> None:
        """Write the predicted poses up to a stamp (ns) of the present pass."""
        for time_pass, stamp, pose in self._predictions.take(self._current.time_pass, until):
            for results in (self._current, self._previous):
                if results is not None and results.takes_prediction(time_pass, stamp):
                    results.write_prediction(pose)
                    break

    def add_landmarks(self, stamp: int, landmarks: LandmarkMap, raw: Raw) -> None:
        """Add a map as of a stamp (ns)."""
        results = self._current
        previous = self._previous
        if previous is not None and stamp == previous.last_stamp != self._current.last_stamp:
            results = previous
        if not results.finished:
            results.map_stamp = stamp
            results.writer.set_landmarks(landmarks)
            results.write_raw(raw, stamp)

    def add_latched(self, raw: Raw) -> None:
        """Add a message that holds until another comes; of the same again, only the first."""
        plain = Raw(raw.topic, without_padding(raw.data, raw.topic.msgtype))
        before = self._latched.get(raw.topic)
        self._latched[raw.topic] = plain
        if before is None or before.data[_AFTER_STAMP:] != plain.data[_AFTER_STAMP:]:
            self.add_other(raw)

    def add_other(self, raw: Raw) -> None:
        """Add a message that only goes to ``results.mcap``."""
        if not self._current.finished:
            self._current.write_raw(raw)

    def set_parameters(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        """Write ``params.yaml``: node, then name, then value, of those that a pass began with."""
        self._parameters = parameters
        for results in (*self._early, self._current):
            self._write_parameters(results)

    def add_changes(self, stamp: int, node: str, changes: Mapping[str, tuple[Any, Any]]) -> None:
        """Add parameters of a node that changed, their values before and from a step (ns) on."""
        if not changes:
            return
        current = self._current
        for name, (before, value) in changes.items():
            current.began_with.setdefault(node, {}).setdefault(name, before)
            self._changed.setdefault(node, {})[name] = value
            current.writer.add_change(stamp, node, name, before, value)
        self._write_parameters(current)

    def _write_parameters(self, results: _Pass) -> None:
        if self._parameters:
            told, before = self._parameters.items(), results.began_with
            began_with = {node: {**own, **before.get(node, {})} for node, own in told}
            results.writer.set_parameters(began_with)

    def set_process(self, *, peak_rss_mb: float | None, resets: int) -> None:
        """Set what only slam_node knows of itself."""
        self._current.writer.summary.peak_rss_mb = peak_rss_mb
        self._current.writer.summary.resets = resets

    def set_verdict(self, verdict: Judgement) -> None:
        """Set the verdict on the pass that ends with its stamp, or so far on the present one."""
        results, previous = self._current, self._previous
        if previous is not None and verdict.stamp == previous.last_stamp != results.last_stamp:
            results = previous
        is_final = verdict.stamp == results.last_stamp
        if is_final or not results.has_final_verdict:
            results.writer.summary.verdict = verdict

    def set_refused(self, refused: Mapping[str, int], first: Mapping[str, str]) -> None:
        """Set how many messages the nodes refused by word, and the stamps (s) of the first."""
        summary = self._current.writer.summary
        summary.refused, summary.refused_first = refused, first

    def refresh(self) -> None:
        """Bring files up to date that are a second old, and close a pass that is over."""
        self._current.refresh()
        if self._previous is not None:
            self._previous.refresh()
            predictions_are_over = self._predictions.time_pass > self._previous.time_pass
            ready = self._previous.has_final_map and predictions_are_over
            if ready or time.monotonic() > self._previous_until:
                self._finish_previous()

    def flush(self) -> None:
        """Bring all files up to date now."""
        if not self._current.finished:
            self._write_predictions()
            self._current.writer.flush()
            if self._current.log is not None:
                self._current.log.flush()

    def finish(self, *, complete: bool, reason: str | None = None) -> None:
        """Close all files, saying whether the run ended whole and, if not, why."""
        try:
            self._write_predictions()
            self._finish_previous()
        finally:
            self._current.finish(complete=complete, reason=reason)

    def announce_end(self, reason: str) -> None:
        """Say on disk why the run will have ended early; what still comes is written."""
        if not self._current.finished:
            self._current.writer.summary.incomplete_reason = reason
            self._current.writer.flush()

    def _begin_pass(self, begin: int, *, jumped: bool) -> None:
        self._finish_previous()
        self._count += 1
        self._previous, self._previous_jumped = self._current, jumped
        self._previous_until = time.monotonic() + self._previous.map_patience
        self._current = _Pass(
            pass_directory(self._directory, self._count),
            force=self._force,
            record_mcap=self._record_mcap,
        )
        self._current.writer.summary.refused_before = self._previous.writer.summary.refused
        self._current.time_pass = self._previous.time_pass + jumped
        self._current.begin = None if jumped else begin
        self._current.began_with = {node: dict(own) for node, own in self._changed.items()}
        self._write_parameters(self._current)
        self._early.append(self._previous)
        for raw in self._latched.values():
            self._current.write_raw(raw)

    def _finish_previous(self) -> None:
        previous, self._previous = self._previous, None
        if previous is None:
            return
        if not self._previous_jumped:
            previous.finish(complete=False, reason="the estimate was reset")
        elif not previous.has_final_map:
            previous.finish(complete=False, reason="the landmark map did not arrive")
        else:
            previous.finish(complete=True, reason=None)
