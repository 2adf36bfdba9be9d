# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam report``: results as one HTML page."""

import argparse
from pathlib import Path
from typing import Any

from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.lines import answer
from vislam_ros.data.evaluation.association import read_reference
from vislam_ros.data.files.json_file import read_json
from vislam_ros.data.results.reader import read_results
from vislam_ros.errors import VislamError

_FINDINGS = "findings.json"


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    results = read_results(arguments.directory)
    reference = read_reference(arguments.reference, results) if arguments.reference else None
    findings = _findings(arguments.directory, arguments.findings)
    output = arguments.output or arguments.directory / "report.html"
    from vislam_ros.data.report.page import write_report

    write_report(
        results,
        output,
        reference=reference,
        reference_path=arguments.reference,
        findings=findings,
        force=arguments.force,
    )
    answer(str(output))
    return OK


def _findings(directory: Path, given: Path | None) -> list[dict[str, Any]] | None:
    """Findings of the file that is given, or that lies in the directory; None without one."""
    path = given or directory / _FINDINGS
    if given is None and not path.exists():
        return None
    findings = read_json(path, "these findings").get("findings")
    if not isinstance(findings, list) or not all(isinstance(each, dict) for each in findings):
        raise VislamError(
            f"{path}: findings is not a list of objects: it must be as `vislam inspect DATA "
            "--json` prints it"
        )
    return findings
