# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksums of a bag directory: neither the bag's writer nor its readers notice a flipped byte."""

import hashlib
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Message
from mcap.stream_reader import StreamReader

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.bag_messages import BagConnection, BagMessages, is_bag
from vislam_ros.data.bags.claims import mcap_claim
from vislam_ros.data.bags.layout import CHECKSUMS, PROVENANCE, TOPICS
from vislam_ros.data.files.inputs import open_input
from vislam_ros.errors import VislamError

# Of more files than any bag has [bytes].
_LARGEST_CHECKSUMS = 1 << 22
_LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")


@dataclass(frozen=True)
class VerifyReport:
    """What :func:`verify_bag` found.

    Attributes
    ----------
    path : Path
    faults : tuple of str
        One line for each; empty where the bag is whole.
    notes : tuple of str
        What is no fault and yet worth knowing, such as that there are no checksums.
    """

    path: Path
    faults: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def intact(self) -> bool:
        """Whether no fault was found."""
        return not self.faults


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    with open_input(path) as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def write_checksums(bag: Path) -> None:
    """Write ``SHA256SUMS`` over every other file of a bag directory."""
    (bag / CHECKSUMS).write_text(_checksum_text(_digests(bag)), encoding="utf-8")


def verify_bag(path: Path) -> VerifyReport:
    """Look for damage in a bag.

    A bag with ``SHA256SUMS`` must match it, and that file must be the very one that would be
    written again. One that was recorded elsewhere has only its storage's own structure and CRCs.

    Parameters
    ----------
    path : Path
        A bag directory or a bare ``.mcap`` file.

    Raises
    ------
    VislamError
        Where there is no bag to look at.
    """
    if path.is_dir() and (path / CHECKSUMS).is_file():
        return VerifyReport(path, tuple(_checksum_faults(path)), ())
    if path.is_dir() and (path / PROVENANCE).is_file():
        return VerifyReport(path, (f"{CHECKSUMS}: is missing",), ())
    if not path.exists():
        raise VislamError(f"{path}: no such file or directory")
    if not is_bag(path):
        raise VislamError(
            f"{path}: is not a bag: that is a directory with metadata.yaml, or .mcap"
        )
    notes = ("carries no checksums: only its storage's own structure and CRCs were checked",)
    return VerifyReport(path, tuple(_structure_faults(path)), notes)


def require_intact(path: Path) -> VerifyReport:
    """Verify a bag and refuse it where it is damaged.

    Raises
    ------
    VislamError
        One line with the first fault and the number of all.
    """
    report = verify_bag(path)
    if report.faults:
        more = f" (and {len(report.faults) - 1} more)" if len(report.faults) > 1 else ""
        raise VislamError(
            f"{path}: damaged: {report.faults[0]}{more}: convert or copy it anew; "
            "vislam verify lists every fault"
        )
    return report


def _digests(bag: Path) -> dict[str, str]:
    names = sorted(
        file.relative_to(bag).as_posix() for file in bag.rglob("*") if not file.is_dir()
    )
    return {name: file_sha256(bag / name) for name in names if name != CHECKSUMS}


def _checksum_text(digests: dict[str, str]) -> str:
    return "".join(f"{digest}  {name}\n" for name, digest in digests.items())


def _checksum_faults(bag: Path) -> list[str]:
    try:
        with open_input(bag / CHECKSUMS) as file:
            recorded = file.read(_LARGEST_CHECKSUMS)
        actual = _digests(bag)
    except VislamError as error:
        return [str(error).removeprefix(f"{bag}/")]
    if recorded == _checksum_text(actual).encode():
        return []
    faults = []
    listed: dict[str, str] = {}
    for number, line in enumerate(recorded.decode("utf-8", "replace").splitlines(), start=1):
        if match := _LINE.fullmatch(line):
            listed[match[2]] = match[1]
        else:
            faults.append(f"{CHECKSUMS}: line {number} is not a checksum, two spaces and a name")
    for name, digest in listed.items():
        if name not in actual:
            faults.append(f"{name}: is missing, though {CHECKSUMS} lists it")
        elif actual[name] != digest:
            faults.append(f"{name}: does not match its checksum in {CHECKSUMS}")
    faults.extend(f"{name}: is not listed in {CHECKSUMS}" for name in actual if name not in listed)
    return faults or [f"{CHECKSUMS}: is not in the form in which it was written"]


def _structure_faults(path: Path) -> list[str]:
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    faults = [
        f"{file.name}: {fault}"
        for file in files
        if file.suffix == ".mcap" and (fault := mcap_claim(file) or _mcap_fault(file))
    ]
    if faults:
        return faults
    try:
        with BagMessages(path) as bag:
            expected = sum(connection.count for connection in bag.connections)
            found, no_messages = _look_at_messages(bag)
    except VislamError as error:
        return [str(error).removeprefix(f"{path}: ")]
    faults = []
    if no_messages:
        names = " and ".join(each.topic for each in no_messages)
        faults.append(f"no usable message on {names}: {Refusal.UNDECODABLE.text}")
    if found != expected:
        faults.append(f"holds {found} messages where its index says {expected}")
    return faults


def _look_at_messages(bag: BagMessages) -> tuple[int, list[BagConnection]]:
    """Count the messages, and name the topics of types in use of which none can be decoded."""
    in_use = {topic.msgtype for topic in TOPICS}
    unproven = {each.topic: each for each in bag.connections if each.msgtype in in_use}
    found = 0
    for connection, _, data in bag.messages():
        found += 1
        if connection.topic in unproven:
            with suppress(RefusedMessage):
                bag.decode(connection, data)
                del unproven[connection.topic]
    return found, [each for each in unproven.values() if each.count]


def _mcap_fault(file: Path) -> str | None:
    """Read an MCAP file from its first byte to its last, with every CRC that it carries."""
    try:
        with open_input(file, "this bag") as stream:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Message):
                    continue
            if stream.read(1):
                return "goes on after its end"
    except Exception as error:  # damage shows as any error of the parser or the decompressor
        return f"truncated or damaged ({type(error).__name__}: {error})".replace("\n", " ")
    return None
