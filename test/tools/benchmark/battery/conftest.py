# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest
from benchmark.battery import measuring
from benchmark.battery.trials import Trial

from vislam_ros.data.sweeps.log import SweepLog
from vislam_ros.data.sweeps.run import Row


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Keys of the trials that run, in this process and in no time."""
    keys: list[str] = []

    def run(log: SweepLog, _: object, missing: list[Trial], jobs: int) -> None:
        assert jobs == 2
        for trial in missing:
            keys.append(trial.key)
            row: Row = {"key": trial.key, "error": None}
            row |= dict.fromkeys(("estimate_percent", "dead_reckoning_percent"), 2.0)
            log.append(row | dict.fromkeys(("estimate_m", "dead_reckoning_m"), 1.0))

    monkeypatch.setattr(measuring, "_run", run)
    return keys
