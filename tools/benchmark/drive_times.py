# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The time of a whole drive: inside this process, and as the command that a user types."""

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import vislam_ros
from benchmark.interleaving import cpu_clock
from vislam_ros.core.settings import PredictionSettings, SlamSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare, evaluate_results
from vislam_ros.data.results.summary import read_summary
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

_LONGEST_RUN = 900.0  # seconds


def solve_here(
    drive: Drive,
    slam_settings: SlamSettings,
    prediction_settings: PredictionSettings,
    reference: Trajectory | None,
) -> dict[str, Any]:
    """Solve a drive that is already in memory."""
    begin, cpu_begin = time.perf_counter(), cpu_clock()
    solution = solve(drive, slam_settings, prediction_settings)
    wall, cpu = time.perf_counter() - begin, cpu_clock() - cpu_begin
    milliseconds = solution.steps["ms"]
    return {
        "name": "in this process",
        "steps": len(milliseconds),
        "landmarks": len(solution.landmarks),
        "wall_s": wall,
        "cpu_s": cpu,
        "step_ms_p50": float(np.percentile(milliseconds, 50)),
        "step_ms_p99": float(np.percentile(milliseconds, 99)),
        "ate_m": reference and compare(reference, solution.trajectory)["ate_m"]["rmse"],
    }


def solve_as_command(
    data: Path, arguments: Sequence[str], reference: Path | None
) -> dict[str, Any]:
    """Run ``vislam solve DATA`` on one core and wait for its end.

    Raises
    ------
    VislamError
        Where the command fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "results"
        command = [*_VISLAM, "solve", str(data), "--out", str(out), *arguments]
        begin = time.perf_counter()
        with tempfile.TemporaryFile() as errors:
            process = subprocess.Popen(
                command, env=_environment(), stdout=subprocess.DEVNULL, stderr=errors
            )
            os.sched_setaffinity(process.pid, {min(os.sched_getaffinity(0))})
            watchdog = threading.Timer(_LONGEST_RUN, process.kill)
            watchdog.start()
            # wait4, and not the module resource, for this one child's own figures.
            _, status, usage = os.wait4(process.pid, 0)
            watchdog.cancel()
            process.returncode = os.waitstatus_to_exitcode(status)
            wall = time.perf_counter() - begin
            if process.returncode:
                errors.seek(0)
                said = errors.read().decode("utf-8", "replace").strip().splitlines()
                raise VislamError(
                    f"vislam solve {data} ended with {process.returncode}: {said[-1:]}"
                )
        summary = read_summary(out / "summary.json")
        errors_m = evaluate_results(out, reference) if reference else {}
    return {
        "name": "vislam solve" + (" --smooth" if "--smooth" in arguments else ""),
        "steps": summary["steps"],
        "landmarks": summary["landmarks"],
        "wall_s": wall,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "user_s": usage.ru_utime,
        "system_s": usage.ru_stime,
        # Not ru_maxrss, which counts what this process held when it started the command.
        "peak_rss_mb": summary["peak_rss_mb"],
        "steps_wall_s": summary["wall_s"],
        "step_ms_p50": summary["step_ms_p50"],
        "step_ms_p99": summary["step_ms_p99"],
        "ate_m": _rmse(errors_m.get("trajectory")),
        "ate_smoothed_m": _rmse(errors_m.get("smoothed")),
        "nees_per_dof": errors_m.get("trajectory", {}).get("nees_per_dof"),
    }


_VISLAM = [sys.executable, "-m", "vislam_ros.cli.main"]


def _environment() -> dict[str, str]:
    """Environment in which the child finds this very package."""
    folder = str(Path(vislam_ros.__file__).parents[1])
    paths = [folder, *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def _rmse(figures: dict[str, Any] | None) -> float | None:
    return float(figures["ate_m"]["rmse"]) if figures else None
