# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path

import pytest
from step_rows import step_row

from vislam_ros.data.results.summary import RunSummary, peak_rss_mb, read_summary
from vislam_ros.errors import VislamError

STEP = 100_000_000


def test_an_empty_run_has_every_field_and_claims_nothing() -> None:
    summary = RunSummary().as_dict()
    assert summary["steps"] == 0
    assert summary["complete"] is False
    assert summary["incomplete_reason"]
    unknown = (
        "estimator",
        "gyro_bias",
        "rejected_fraction",
        "nis_per_dof",
        "step_ms_p50",
        "realtime_factor",
        "verdict",
    )
    assert [summary[name] for name in unknown] == [None] * len(unknown)
    assert {
        "frozen_steps",
        "landmarks",
        "tracks",
        "observations",
        "wall_s",
        "total_s",
        "step_ms_p99",
        "peak_rss_mb",
        "latency_ms_p50",
        "latency_ms_p99",
        "resets",
        "refused",
        "verdict_reasons",
        "estimates",
    } <= set(summary)


def test_steps_add_up() -> None:
    run = RunSummary()
    for k in range(101):
        counts = {"used": 6, "rejected": 2, "observed": 10, "landmarks": k}
        nis = {"nis": 9.0, "nis_dof": 18, "gyro_bias_z": 0.001 * k}
        run.add_step(step_row(k * STEP, frozen=k % 2 == 0, ms=float(k), **counts, **nis))
    summary = run.as_dict()
    assert summary["steps"] == 101
    assert summary["frozen_steps"] == 51
    assert summary["observations"] == 1010
    assert summary["rejected_fraction"] == 0.25
    assert summary["nis_per_dof"] == pytest.approx(0.5)
    assert summary["landmarks"] == 100
    assert summary["drive_s"] == pytest.approx(10.0)
    assert (summary["step_ms_p50"], summary["step_ms_p99"]) == (50.0, 99.0)
    assert summary["gyro_bias"] == [0.01, 0.02, 0.1]
    assert summary["estimates"]["gyro_bias_z"] == 0.1
    assert "nis" not in summary["estimates"]
    assert summary["wall_s"] <= summary["total_s"]
    assert summary["realtime_factor"] == pytest.approx(summary["drive_s"] / summary["wall_s"])


def test_what_is_not_finite_is_not_known() -> None:
    run = RunSummary()
    run.add_step(step_row(1, gyro_bias_x=float("nan")))
    summary = run.as_dict()
    assert summary["gyro_bias"] is None
    assert summary["estimates"]["gyro_bias_x"] is None


def test_memory_of_a_process_is_known_and_that_of_none_is_not() -> None:
    if not Path("/proc/self/status").exists():
        pytest.skip("needs Linux' /proc")
    before, after = peak_rss_mb(), peak_rss_mb(os.getpid())
    assert before is not None
    assert after is not None
    assert 1 < before <= after
    assert peak_rss_mb(2**30) is None


@pytest.mark.parametrize("content", ["", "{", "[1]"])
def test_a_file_that_is_no_summary_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(VislamError, match=r"summary\.json: (not a JSON|cannot read)"):
        read_summary(tmp_path / "summary.json")
