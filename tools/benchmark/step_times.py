# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The time of a step: above its floor, beside the dense filter, as map and view grow."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from benchmark.dense_filter import DenseFilter
from benchmark.interleaving import interleave
from benchmark.lapack_floor import LapackFloor
from benchmark.steady_session import SteadySession
from vislam_ros.core.settings import SlamSettings

# Steps that a landmark is seen, on average, in the drives.
_MEAN_TRACK = 13


@dataclass(frozen=True)
class Effort:
    """How often things are measured.

    Attributes
    ----------
    rounds, block : int
        See :func:`benchmark.interleaving.interleave`.
    """

    rounds: int = 15
    block: int = 8


def above_the_floor(
    settings: SlamSettings, active: int, effort: Effort, *, turnover: bool
) -> dict[str, Any]:
    """Measure a step with so many landmarks in view, and in turn with it the LAPACK floor.

    Parameters
    ----------
    settings : SlamSettings
    active : int
    effort : Effort
    turnover : bool
        Whether landmarks come and go as in a drive, one in 13 each step; else all stay.
    """
    session = SteadySession(settings, active, round(active / _MEAN_TRACK) if turnover else 0)
    rows, size = session.update_size
    floor = LapackFloor(rows, size)
    times = interleave(
        {"step": session.step_seconds, "floor": floor, "motion": floor.motion},
        rounds=effort.rounds,
        block=effort.block,
    )
    return {
        "active": session.last.active,
        "new_each_step": session.last.admitted,
        "rows": rows,
        "state": size,
        "step_ms": times["step"].median_ms,
        "filter_ms": session.filter_median_ms,
        "floor_ms": times["floor"].median_ms,
        "motion_ms": times["motion"].median_ms,
        "ratio": times["step"].ratio_to(times["floor"]),
    }


def beside_the_dense_filter(
    settings: SlamSettings, active: int, map_sizes: Sequence[int], effort: Effort
) -> list[dict[str, Any]]:
    """Measure the dense filter over maps of these sizes, and in turn with it a step."""
    rows = []
    for landmarks in map_sizes:
        session = SteadySession(settings, active, 0)
        times = interleave(
            {"step": session.step_seconds, "dense": DenseFilter(landmarks, active)},
            rounds=max(effort.rounds // 5, 2),
            block=2,
        )
        rows.append(
            {
                "landmarks": landmarks,
                "active": active,
                "dense_ms": times["dense"].median_ms,
                "step_ms": times["step"].median_ms,
                "ratio": times["dense"].ratio_to(times["step"]),
            }
        )
    return rows


def growth_with_the_map(
    settings: SlamSettings, active: int, map_sizes: Sequence[int], effort: Effort
) -> list[dict[str, Any]]:
    """Measure, in turn, steps with equal views and maps of these sizes, landmarks coming in.

    The ratios are to the first size.
    """
    sessions = [
        SteadySession(settings, active, round(active / _MEAN_TRACK), landmarks=landmarks)
        for landmarks in map_sizes
    ]
    times = interleave(
        {str(i): session.step_seconds for i, session in enumerate(sessions)},
        rounds=effort.rounds,
        block=effort.block,
    )
    return [
        {
            "landmarks": landmarks,
            "landmarks_at_the_end": session.last.landmarks,
            "active": session.last.active,
            "step_ms": times[str(i)].median_ms,
            "ratio": times[str(i)].ratio_to(times["0"]),
        }
        for i, (landmarks, session) in enumerate(zip(map_sizes, sessions, strict=True))
    ]
