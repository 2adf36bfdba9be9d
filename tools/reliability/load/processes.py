# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Memory and CPU of processes, as the kernel counts them."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")
_USER, _SYSTEM = 11, 12  # fields of /proc/PID/stat after the name of the program
_SECONDS = 600.0


def resident_mb(pid: int) -> float:
    """Memory of a process that is in RAM (MB); NaN where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return float("nan")
    kilobytes = [int(line.split()[1]) for line in lines if line.startswith("VmRSS:")]
    return kilobytes[0] * 1024 / 1e6 if kilobytes else float("nan")


def cpu_seconds(pid: int) -> float:
    """CPU time that a process has taken; NaN where it has ended."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except OSError:
        return float("nan")
    fields = text.rpartition(")")[2].split()
    return (int(fields[_USER]) + int(fields[_SYSTEM])) / _TICKS_A_SECOND


def growth(seconds: ArrayLike, megabytes: ArrayLike, warm_up: float) -> float:
    """Slope of the line through samples of memory after a warm-up: MB in ten minutes.

    Parameters
    ----------
    seconds, megabytes : array_like, (N,)
    warm_up : float
        Seconds; samples before are left out.

    Returns
    -------
    float
        NaN where fewer than two samples are left.
    """
    times, values = np.asarray(seconds, float), np.asarray(megabytes, float)
    use = (times >= warm_up) & np.isfinite(values)
    if np.count_nonzero(use) < 2:
        return float("nan")
    return float(np.polynomial.Polynomial.fit(times[use], values[use], 1).deriv()(0.0)) * _SECONDS


def cpu_shares(
    before: Mapping[str, float], after: Mapping[str, float], seconds: float
) -> dict[str, float]:
    """Share of one core that each process took, of what :func:`cpu_seconds` said twice."""
    return {name: (after[name] - before[name]) / seconds for name in before}
