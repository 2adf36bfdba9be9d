# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a run is complete, live and offline alike; ``complete`` decides the exit code.

A run is complete when all that was sent arrived, each features message was answered by a step or
refused for a reason that lies in the data, there is a step at all, and, live, the map of the last
step was written. What the data are to blame for (:attr:`Refusal.is_of_data`) leaves a run
complete, for any other run over the same messages refuses them again: they are counted and named.
What should have arrived and did not, or what a node failed to use, makes it incomplete.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage, Stream, refusal_of
from vislam_ros.data.bags.layout import FEATURES, PREDICTION

_SLAM, _PREDICTION_NODE = "slam_node", "imu_prediction_node"
TRACKER = "stereo_tracker_node"
"""The node that makes features of images, where these are sent."""

_FEATURES_WORD = f"{Stream.FEATURES.value}_"
# A frame was there before with the stamp of this one, and has its pose.
_DUPLICATE = f"{_FEATURES_WORD}{Refusal.DUPLICATE.word}"
# Share of the frames without a pose that is told, and with fewer frames nothing is.
_LOST, _FEWEST_FRAMES = 0.1, 8


def counts_from_values(values: Mapping[str, str], prefix: str) -> dict[str, int]:
    """Counts among the values of a status, by what follows the prefix of their names.

    Raises
    ------
    RefusedMessage
        ``bad_fields``, where one is no number.
    """
    return {
        key.removeprefix(prefix): count_from_values(values, key)
        for key in values
        if key.startswith(prefix)
    }


def count_from_values(values: Mapping[str, str], key: str) -> int:
    """One of them; 0 where it is not there."""
    try:
        return int(values.get(key, 0))
    except ValueError as error:
        raise RefusedMessage(
            Refusal.BAD_FIELDS, f"{key}: {values[key]!r} is no whole number"
        ) from error


def describe_refused(refused: Mapping[str, int], first: Mapping[str, str]) -> str:
    """One line on refused messages by word, with the stamp (s) of the first where it is known."""
    return "; ".join(
        f"{count} {word} ({refusal_of(word).text}"
        + (f", the first at {first[word]} s)" if word in first else ")")
        for word, count in refused.items()
    )


def shortfall(steps: int, refused: Mapping[str, int], first: Mapping[str, str]) -> str | None:
    """Why a run over messages that all arrived is not complete, or None."""
    if not steps:
        reason = describe_refused(refused, first) or "there were no features"
        return f"not one step: {reason}"
    faults = {word: n for word, n in refused.items() if not refusal_of(word).is_of_data}
    return f"refused {describe_refused(faults, first)}" if faults else None


def lost_frames(steps: int, refused: Mapping[str, int], first: Mapping[str, str]) -> str | None:
    """How many frames have no pose, and why, in one line; None where they are few.

    Parameters
    ----------
    steps : int
    refused : mapping of str to int
        Messages by word, those of other streams, too.
    first : mapping of str to str
        Stamp (s) of the first of them.
    """
    lost = {
        word: count
        for word, count in refused.items()
        if word.startswith(_FEATURES_WORD) and word != _DUPLICATE
    }
    count = sum(lost.values())
    frames = steps + count
    if frames < _FEWEST_FRAMES or count <= _LOST * frames:
        return None
    return f"{count / frames:.0%} of the frames have no pose: {describe_refused(lost, first)}"


@dataclass(frozen=True)
class NodeReport:
    """What a node last said of itself on /diagnostics.

    Attributes
    ----------
    received : dict of str to int
        Messages it was sent, by topic.
    refused : dict of str to int
        Those it did not use, by word.
    first : dict of str to str
        Stamp (s) of the first of them.
    waiting : int
        Feature frames that are neither answered nor refused yet.
    refused_at_end : dict of str to int
        Messages that it will not have used if nothing more comes, by word.
    first_at_end : dict of str to str
        Stamp (s) of the first of them.
    predictions : int
        Predicted poses that it published.
    steps : int
        Steps that it published.
    features : int
        Feature frames that it published.
    """

    received: dict[str, int] = field(default_factory=dict)
    refused: dict[str, int] = field(default_factory=dict)
    first: dict[str, str] = field(default_factory=dict)
    waiting: int = 0
    refused_at_end: dict[str, int] = field(default_factory=dict)
    first_at_end: dict[str, str] = field(default_factory=dict)
    predictions: int = 0
    steps: int = 0
    features: int = 0

    @classmethod
    def of_values(cls, values: Mapping[str, str]) -> "NodeReport":
        """Report of the values of a status on /diagnostics.

        Raises
        ------
        RefusedMessage
            ``bad_fields``, where a count is no number, or nothing is refused for such a reason.
        """
        refused, first = _refused_of(values, "")
        refused_at_end, first_at_end = _refused_of(values, "at end ")
        return cls(
            received=counts_from_values(values, "received "),
            refused=refused,
            first=first,
            waiting=count_from_values(values, "features waiting"),
            refused_at_end=refused_at_end,
            first_at_end=first_at_end,
            predictions=count_from_values(values, "predictions"),
            steps=count_from_values(values, "steps"),
            features=count_from_values(values, "features published"),
        )

    @property
    def features_refused(self) -> int:
        """Features messages that it did not use."""
        return sum(n for word, n in self.refused.items() if word.startswith(_FEATURES_WORD))

    @property
    def unanswered(self) -> int:
        """Features messages that came and were neither answered nor refused, and do not wait."""
        came = self.received.get(FEATURES.name, 0)
        return came - self.steps - self.features_refused - self.waiting


# Far more than are taken before the publisher hears of it.
_LATELY = 1000


@dataclass
class RecordedSteps:
    """Counts the steps of a recording by the numbers that slam_node gives them.

    DDS sends anew what it does not know was taken, to a node that it had taken for gone.

    Attributes
    ----------
    count : int
    missing : int
        Numbers that were left out between the first and the last.
    last : int or None
        Number of the last one.
    """

    count: int = 0
    missing: int = 0
    last: int | None = None
    _lately: dict[tuple[int, int], None] = field(default_factory=dict)

    def has(self, number: int, stamp: int) -> bool:
        """Whether a step with this stamp (ns) was counted lately."""
        return (number, stamp) in self._lately

    def add(self, number: int, stamp: int, *, first_of_pass: bool = False) -> None:
        """Count a step; numbers begin anew with a new slam_node, which begins a pass."""
        if first_of_pass:
            self._lately.clear()
        self._lately[number, stamp] = None
        if len(self._lately) > _LATELY:
            del self._lately[next(iter(self._lately))]
        if self.last is not None and number > self.last:
            self.missing += number - self.last - 1
        self.count += 1
        self.last = number


def _refused_of(values: Mapping[str, str], prefix: str) -> tuple[dict[str, int], dict[str, str]]:
    """Refused messages by word, and the stamp (s) of the first of each, where it has one."""
    refused = counts_from_values(values, f"{prefix}refused ")
    try:
        for word in refused:
            refusal_of(word)
    except ValueError as error:
        raise RefusedMessage(Refusal.BAD_FIELDS, str(error)) from error
    first = {word: values.get(f"{prefix}first {word} [s]") for word in refused}
    return refused, {word: stamp for word, stamp in first.items() if stamp is not None}


class Ledger:
    """Compares what a player has sent with what the nodes say became of it."""

    def __init__(self) -> None:
        self._sent: Mapping[str, int] = {}
        self._reports: dict[str, NodeReport] = {}
        self._before: dict[str, NodeReport] = {}
        self._joined: dict[str, NodeReport] | None = None

    @property
    def features_sent(self) -> int:
        """Features messages that the player has sent, or the tracker made of its images."""
        return self._sent.get(FEATURES.name, 0) + self._since(TRACKER).features

    def begin(self) -> None:
        """Count only what nodes are sent from now on."""
        self._before = dict(self._reports)

    def received(self, node: str, topic: str) -> int:
        """How many messages a node says that it was sent since the player began."""
        return self._since(node).received.get(topic, 0)

    def set_sent(self, sent: Mapping[str, int]) -> bool:
        """Note how much a player has sent, by topic; tell whether another player has begun."""
        begins = any(sent.get(topic, 0) < count for topic, count in self._sent.items())
        if begins:
            self.begin()
        self._sent = sent
        return begins

    def join(self) -> None:
        """Note that the nodes were at work before: what they refused up to now is not ours."""
        self._joined = dict(self._reports)

    def set_report(self, node: str, report: NodeReport) -> bool:
        """Note what a node says; tell whether it is news."""
        if self._joined is not None:
            self._joined.setdefault(node, report)
        is_news = self._reports.get(node) != report
        self._reports[node] = report
        return is_news

    def unanswered(self, steps: int) -> int:
        """Features messages that were sent and came to nothing yet, given the steps so far."""
        report = self._since(_SLAM)
        return max(0, self.features_sent - steps - report.features_refused - report.waiting)

    def is_settled(self, steps: int) -> bool:
        """Whether nothing is on its way any more, given the steps so far."""
        return not self.missing() and not self.unanswered(steps)

    def missing(self) -> dict[str, int]:
        """Messages that were sent and have not arrived yet where they are used, by topic."""
        sent = {
            **self._sent,
            FEATURES.name: self.features_sent,
            PREDICTION.name: self._since(_PREDICTION_NODE).predictions,
        }
        return {
            topic: sent[topic] - arrived
            for node in tuple(self._reports)
            for topic, arrived in self._since(node).received.items()
            if arrived < sent.get(topic, 0)
        }

    def refused(self, *, at_end: bool) -> tuple[dict[str, int], dict[str, str]]:
        """Refused messages of all nodes by word, and the stamp (s) of the first of each.

        At the end, those that still wait for something are refused too: it is not to come.
        """
        refused: Counter[str] = Counter()
        first: dict[str, str] = {}
        for node, report in sorted(self._reports.items()):
            before = (self._joined or {}).get(node, NodeReport())
            news = Counter(report.refused) - Counter(before.refused)
            refused.update(news)
            fresh = {word: s for word, s in report.first.items() if word not in before.refused}
            first = {**fresh, **first}
            if at_end:
                refused.update(report.refused_at_end)
                first = {**report.first_at_end, **first}
        return dict(sorted(refused.items())), dict(sorted(first.items()))

    def shortfall(self, steps: int) -> str | None:
        """Why the run is not complete, or None, given how many steps were recorded."""
        if missing := self.missing():
            lost = ", ".join(f"{count} of {topic}" for topic, count in missing.items())
            return f"messages did not arrive: {lost}; {steps} steps"
        if unanswered := self.unanswered(steps):
            return f"{unanswered} of {self.features_sent} features messages were not answered"
        return shortfall(steps, *self.refused(at_end=True))

    def gap(self, recorded: RecordedSteps, *, to_the_end: bool) -> str | None:
        """What is missing in a recording that no player tells the extent of, or None.

        Parameters
        ----------
        recorded : RecordedSteps
        to_the_end : bool
            Whether slam_node has published nothing that is not to be part of it.
        """
        report = self._reports.get(_SLAM)
        if report is None:
            return "slam_node has told nothing of itself"
        if report.steps and not recorded.count:
            return f"not one step: slam_node had published its {report.steps} before"
        late = report.steps - recorded.last if to_the_end and recorded.last is not None else 0
        if lost := recorded.missing + max(0, late):
            return f"{lost} of {recorded.count + lost} steps did not arrive"
        before = (self._joined or {}).get(_SLAM, NodeReport())
        if (unanswered := report.unanswered - before.unanswered) > 0:
            return f"{unanswered} features messages were not answered"
        return shortfall(recorded.count, *self.refused(at_end=False))

    def _since(self, node: str) -> NodeReport:
        """What a node says has happened since the player began."""
        now, before = (r.get(node, NodeReport()) for r in (self._reports, self._before))
        return replace(
            now,
            received={t: n - before.received.get(t, 0) for t, n in now.received.items()},
            refused={w: n - before.refused.get(w, 0) for w, n in now.refused.items()},
            predictions=now.predictions - before.predictions,
            features=now.features - before.features,
        )
