# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How ``solve`` and ``run`` end: the same table, notes and exit code for the same results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from vislam_ros.cli.lines import tell, tell_next
from vislam_ros.cli.screen import print_summary
from vislam_ros.core.verdict.reason import Word
from vislam_ros.data.results.completeness import describe_refused
from vislam_ros.errors import VislamError

PassResults: TypeAlias = tuple[Path, Mapping[str, Any]]
"""Result directory of a pass, and its summary."""


def print_passes(passes: Sequence[PassResults]) -> None:
    """Print what came of each pass, and last whether its estimate can be trusted."""
    for directory, summary in passes:
        print_summary(f"{summary['drive']} in {directory}", summary)
        if summary["verdict"]:
            reasons = "; ".join(summary["verdict_reasons"])
            print(f"verdict: {summary['verdict']}" + (f": {reasons}" if reasons else ""))


def require_complete(passes: Sequence[PassResults]) -> None:
    """Name what was refused on the way to complete results.

    Raises
    ------
    VislamError
        Where a pass is not complete (see :mod:`vislam_ros.data.results.completeness`).
    """
    for directory, summary in passes:
        if not summary["complete"]:
            raise VislamError(f"{directory}: incomplete: {summary['incomplete_reason']}")
    if left_out := sum(summary["left_out"] for _, summary in passes):
        tell(
            f"warning: {left_out} observations left out: frames have more new tracks than "
            "max_active has room for"
        )
    _, last = passes[-1]
    if last["refused"]:
        refused = describe_refused(last["refused"], last["refused_first"])
        tell(f"note: not used: {refused}")


def tell_written(passes: Sequence[PassResults], data: Path) -> None:
    """Name the files of each pass on standard error, and what comes next.

    Of data that contradict themselves ``inspect`` has more to say.

    Parameters
    ----------
    passes : sequence of tuple
    data : Path
        What was estimated from; the truth stands beside it where it was simulated.
    """
    for directory, _ in passes:
        names = sorted(path.name for path in directory.iterdir() if path.is_file())
        tell(f"wrote {directory}: {', '.join(names)}")
    if any(summary["verdict"] == Word.CONTRADICTION.value for _, summary in passes):
        tell_next("inspect", str(data))
        return
    truth = data.with_suffix(".tum")
    reference = str(truth) if truth.is_file() else "REF.tum"
    tell_next("evaluate", str(passes[0][0]), "--reference", reference)
