# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One target under the fuzzer: counts what is executed, and keeps what it finds and goes on."""

import hashlib
import json
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from reliability.fuzzing.targets import Target
from vislam_ros.data.results.summary import peak_rss_mb
from vislam_ros.errors import VislamError

#: What an input may take until it is refused.
MOST_SECONDS, MOST_MEGABYTES = 2.0, 500.0
_UNFORESEEN = "cannot be read as vislam_ros"
# The fuzzer ends the process by itself, so what was counted is written down before.
_REPORT_EVERY, _LOOK_EVERY = 500, 64


class Campaign:
    """Reads inputs of a target.

    Parameters
    ----------
    target : Target
    folder : Path
        That the target's file lies below.
    finds : Path
        Where inputs go that end other than they should, and ``TARGET.json`` with what came of all.
    """

    def __init__(self, target: Target, folder: Path, finds: Path):
        self._target = target
        self._folder = folder
        self._file = folder / target.file
        self.finds = finds
        self._report = finds / f"{target.name}.json"
        self._executions = self._read = 0
        self._slowest = 0.0
        self._kinds: dict[str, dict[str, Any]] = {}
        if self._report.exists():
            before = json.loads(self._report.read_bytes())
            self._executions, self._read = before["executions"], before["read"]
            self._kinds, self._slowest = before["finds"], before["slowest_s"]
        self._memory = peak_rss_mb() or 0.0

    def run(self, data: bytes) -> None:
        """Read one input."""
        self._file.write_bytes(data)
        begin = time.process_time()
        try:
            self._target.read(self._folder)
            self._read += 1
        except VislamError as error:
            cause = error.__cause__
            # What the reader of a format did not foresee is told in a line, too, and is a find.
            if isinstance(cause, MemoryError) or (cause and _UNFORESEEN in str(error)):
                self._keep(type(cause).__name__, data, cause)
        except Exception as error:
            self._keep(type(error).__name__, data, error)
        seconds = time.process_time() - begin
        self._slowest = max(self._slowest, seconds)
        if seconds > MOST_SECONDS:
            self._keep("slow", data, None, f"{seconds:.1f} s")
        due = self._executions % _LOOK_EVERY == 0
        memory = (peak_rss_mb() or 0.0) if due else self._memory
        if memory > self._memory + MOST_MEGABYTES:
            self._keep("large", data, None, f"{memory - self._memory:.0f} MB")
            self._memory = memory
        self._executions += 1
        if self._executions % _REPORT_EVERY == 0:
            self.report()

    def report(self) -> None:
        """Write down what came of all."""
        content = {
            "executions": self._executions,
            "read": self._read,
            "slowest_s": round(self._slowest, 3),
            "finds": self._kinds,
        }
        self._report.write_text(json.dumps(content, indent=1) + "\n")

    def _keep(self, kind: str, data: bytes, error: BaseException | None, what: str = "") -> None:
        """Keep the first input of a kind, which is an error at a place."""
        place = ""
        if error is not None:
            frames = traceback.extract_tb(error.__traceback__)
            ours = [f for f in frames if "vislam_ros" in f.filename] or frames
            place = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""
            what = f"{type(error).__name__}: {error}"[:200]
        key = f"{kind} {place}".strip()
        if key in self._kinds:
            self._kinds[key]["count"] += 1
            return
        name = f"{self._target.name}_{hashlib.sha256(data).hexdigest()[:12]}"
        (self.finds / name).write_bytes(data)
        self._kinds[key] = {"count": 1, "file": name, "what": what}
        self.report()


def fuzz(target: Target, campaign: Campaign, corpus: Path, executions: int, seconds: int) -> None:
    """Let atheris choose inputs; does not return, for the fuzzer ends the process."""
    import atheris

    for number, seed in enumerate(target.seeds):
        (corpus / f"seed_{number}").write_bytes(seed)

    def mutated(data: bytes, largest: int, seed: int) -> bytes:
        changed: bytes = atheris.Mutate(data, len(data))
        return target.mend(changed)[:largest] if seed % 8 else changed

    largest = max(2 * max(map(len, target.seeds)), 256)
    options = [
        f"-runs={executions}",
        f"-max_total_time={seconds}",
        f"-max_len={largest}",
        "-timeout=60",
        "-rss_limit_mb=4000",
        "-print_final_stats=1",
        f"-artifact_prefix={campaign.finds}/",
        str(corpus),
    ]
    arguments: dict[str, Callable[..., bytes]] = {}
    if target.mend is not bytes:
        arguments["custom_mutator"] = mutated
    atheris.Setup([sys.argv[0], *options], campaign.run, **arguments)
    atheris.Fuzz()
