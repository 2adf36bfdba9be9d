# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What data are, whatever they are: a dataset, a bag or images, and what is wrong with them."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vislam_ros.data.bags.bag_messages import is_bag
from vislam_ros.data.bags.integrity import require_intact
from vislam_ros.data.bags.reader import DEFAULT_RULES, ReadingRules, read_passes
from vislam_ros.data.datasets import npz
from vislam_ros.data.datasets.conventions import AS_FOUND, Conventions
from vislam_ros.data.datasets.formats import format_of, read_dataset
from vislam_ros.data.datasets.mending import AS_STORED, Mending
from vislam_ros.data.drive import Drive
from vislam_ros.data.finding import Finding
from vislam_ros.data.image_sources import holds_images, read_images
from vislam_ros.data.inspection.bag_streams import streams_of_bag
from vislam_ros.data.inspection.facts import facts_of
from vislam_ros.data.inspection.judging import Reread, judge
from vislam_ros.data.inspection.streams import Stream, judge_stamps
from vislam_ros.errors import VislamError


@dataclass
class Inspection:
    """What data are, and what is wrong with them.

    Attributes
    ----------
    path, kind, name : str
        Kind is ``dataset``, ``bag`` or ``images``.
    facts : dict
        Figures, see :func:`vislam_ros.data.inspection.facts.facts_of`; empty for what cannot be
        read.
    streams : tuple of Stream
    findings : list of Finding
    unknown : dict of str to str
        Why something was not judged, by its name.
    notes : tuple of str
        What else a reader says.
    error : str
        Why the data cannot be used; empty where they can.
    """

    path: str
    kind: str
    name: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    streams: tuple[Stream, ...] = ()
    findings: list[Finding] = field(default_factory=list)
    unknown: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    error: str = ""

    def as_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "path": self.path,
            "kind": self.kind,
            "name": self.name,
            "usable": not self.error,
            "error": self.error,
            "facts": self.facts,
            "streams": {each.name: each.as_dict() for each in self.streams},
            "findings": [each.as_dict() for each in self.findings],
            "not_judged": self.unknown,
            "notes": list(self.notes),
        }


def inspect(
    path: Path,
    motion: Path | None = None,
    *,
    conventions: Conventions = AS_FOUND,
    rules: ReadingRules = DEFAULT_RULES,
    topics: Mapping[str, str] | None = None,
    namespace: str = "",
) -> Inspection:
    """Inspect a dataset, a bag or images; arguments as ``load_passes``.

    Raises
    ------
    VislamError
        Where nothing can be told of them but that they cannot be read.
    """
    of_bag = is_bag(path)
    if of_bag:
        require_intact(path)
    if holds_images(path, motion, topics):
        images = read_images(
            path,
            motion,
            conventions=conventions,
            rules=rules,
            topics=topics,
            namespace=namespace,
        )
        # OpenCV takes a while to import, which others need not wait for.
        from vislam_ros.data.inspection.images import inspect_images

        told = Inspection(str(path), "images", images.name, notes=images.notes)
        inspect_images(told, images)
        if of_bag:
            _judge_bag(told, path)
        return told
    if format_of(path):
        return _of_dataset(path, conventions)
    if of_bag:
        return _of_bag(path, rules, topics, namespace)
    if not path.exists():
        raise VislamError(f"{path}: no such file or directory")
    raise VislamError(f"{path}: is neither a dataset of a known format nor a bag, nor images")


def _of_dataset(path: Path, conventions: Conventions) -> Inspection:
    told = Inspection(str(path), "dataset")
    if format_of(path) is not npz:
        drive = read_dataset(path, conventions=conventions)
        _judge(told, drive)
        return told

    def reread(mending: Mending) -> Drive:
        return npz.read(path, conventions=conventions, mending=mending)

    mending = AS_STORED
    try:
        drive = reread(mending)
    except VislamError as error:
        drive, mending = _first_readable(error, reread)
        told.error = str(error)
    _judge(told, drive, reread, mending)
    return told


def _first_readable(error: VislamError, reread: Reread) -> tuple[Drive, Mending]:
    """Drive that can be read once a fault is undone, or raise what reading it as it is raised."""
    for mending in (Mending(mends_stamps=True), Mending(swaps_sides=True)):
        with suppress(VislamError):
            return reread(mending), mending
    raise error


def _of_bag(
    path: Path, rules: ReadingRules, topics: Mapping[str, str] | None, namespace: str
) -> Inspection:
    told = Inspection(str(path), "bag")
    _judge_bag(told, path)
    try:
        first, *others = read_passes(path, rules=rules, topics=topics, namespace=namespace)
    except VislamError as error:
        if not told.findings:
            raise
        told.error = str(error)
        return told
    if _without_motion(first):
        told.error = f"{path}: no frame has a motion: see its stamps"
        told.name, told.facts = first.name, facts_of(first)
        return told
    _judge(told, first)
    if others:
        told.notes += (f"The stamps begin anew: this is the first of {len(others) + 1} passes.",)
    return told


def _without_motion(drive: Drive) -> bool:
    stamps = drive.twist_stamps
    if not len(stamps):
        return True
    reached = (drive.feature_stamps >= stamps[0]) & (drive.feature_stamps <= stamps[-1])
    return not reached.any()


def _judge_bag(told: Inspection, path: Path) -> None:
    told.streams = streams_of_bag(path)
    judged = [each for each in told.streams if "ground_truth" not in each.name]
    if wrong := judge_stamps(judged):
        told.findings = [wrong, *(each for each in told.findings if each.name != "stamps")]


def _judge(
    told: Inspection,
    drive: Drive,
    reread: Reread | None = None,
    mending: Mending = AS_STORED,
) -> None:
    """Take what a drive in tracks is, and what is wrong with it."""
    told.name, told.facts = drive.name, facts_of(drive)
    said = {each.note for each in drive.findings}
    told.notes += tuple(note for note in drive.notes if note not in said)
    if not told.streams:
        told.streams = (
            Stream.of("frames", drive.feature_stamps),
            Stream.of("motion", drive.twist_stamps),
        )
        wrong = judge_stamps(told.streams)
        if wrong is not None and not any(each.name == "stamps" for each in drive.findings):
            told.findings.append(wrong)
    judged = judge(drive, reread, mending)
    told.findings += judged.findings
    told.unknown |= judged.unknown
    told.facts |= {key: facts_of(judged.drive)[key] for key in ("disparity_px", "depth_m")}
