# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Commands with hostile files, each in a process of its own: what it says, leaves and costs."""

import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from reliability.hostile_files import OUT, Case

#: Until it is refused.
MOST_SECONDS, MOST_MEGABYTES = 2.0, 500.0
_PATIENCE = 60.0
# No input may ask for more than the machine has [bytes].
_ADDRESS_SPACE = 8 << 30


@dataclass(frozen=True)
class Outcome:
    """What became of a command.

    Attributes
    ----------
    case : Case
    code : int
        Negative for the signal that ended it.
    lines : tuple of str
        On standard error, without notes and warnings.
    left : tuple of str
        What it left behind.
    wall_s, cpu_s, megabytes : float
    """

    case: Case
    code: int
    lines: tuple[str, ...]
    left: tuple[str, ...]
    wall_s: float
    cpu_s: float
    megabytes: float

    @property
    def is_one_line(self) -> bool:
        """Whether all that it says is one line of what went wrong, without a traceback."""
        return (
            len(self.lines) == 1
            and self.lines[0].startswith("error: ")
            and ("internal error" not in self.lines[0])
            and self.lines[0].isprintable()
        )

    @property
    def is_right(self) -> bool:
        """Whether it is refused in a line, leaves nothing, and costs little.

        What is right and fails half-way for want of something has done its work until then.
        """
        costs_little = self.cpu_s <= MOST_SECONDS and self.megabytes <= MOST_MEGABYTES
        return (
            self.is_one_line
            and self.code == 1
            and not self.left
            and (costs_little or bool(self.case.limits))
        )


def run(case: Case) -> Outcome:
    """Run a command in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="vislam_hostile_") as scratch:
        place = Path(scratch) / "work"
        place.mkdir()
        arguments = [word.replace(OUT, str(place / "out")) for word in case.arguments]
        log = Path(scratch) / "stderr"
        begin = time.monotonic()
        # What measures coverage writes files of its own.
        environment = {k: v for k, v in os.environ.items() if not k.startswith("COVERAGE_")}
        with log.open("wb") as errors, Path(case.stdout).open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "vislam_ros.cli.main", *arguments],
                cwd=place,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
                env=environment,
                preexec_fn=_limiting(case),
                start_new_session=True,
            )
            timer = threading.Timer(_PATIENCE, process.kill)
            timer.start()
            _, status, usage = os.wait4(process.pid, 0)
            timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        text = log.read_bytes().decode("utf-8", "backslashreplace")
        return Outcome(
            case=case,
            code=process.returncode,
            lines=tuple(line for line in text.split("\n") if line and not line.startswith(_ASIDE)),
            left=tuple(sorted(str(path.relative_to(place)) for path in place.rglob("*"))),
            wall_s=time.monotonic() - begin,
            cpu_s=usage.ru_utime + usage.ru_stime,
            megabytes=usage.ru_maxrss / 1024,
        )


_ASIDE = ("note: ", "warning: ")


def _limiting(case: Case) -> Callable[[], None]:
    limits = {"RLIMIT_AS": _ADDRESS_SPACE, **case.limits}

    def limit() -> None:
        for name, value in limits.items():
            resource.setrlimit(getattr(resource, name), (value, value))

    return limit


def table(outcomes: Iterable[Outcome]) -> list[str]:
    """Lines of a table: a row for each kind, with the worst of it."""
    rows: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        rows.setdefault(outcome.case.kind, []).append(outcome)
    lines = [
        "| kind | tried | one line | exit 1 | nothing left | worst CPU, s | worst MB |",
        "|---|---|---|---|---|---|---|",
    ]
    everything = [outcome for some in rows.values() for outcome in some]
    for kind, some in [*rows.items(), ("all", everything)]:
        lines.append(
            f"| {kind} | {len(some)} | {sum(o.is_one_line for o in some)} "
            f"| {sum(o.code == 1 for o in some)} | {sum(not o.left for o in some)} "
            f"| {max(o.cpu_s for o in some):.2f} | {max(o.megabytes for o in some):.0f} |"
        )
    return lines
