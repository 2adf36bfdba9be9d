# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from benchmark.battery.ablation import measure_ablation
from benchmark.battery.rows import BatteryRow, Simulated
from benchmark.battery.trials import TrialSettings

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings

ROWS: list[BatteryRow] = [Simulated("walk", 6), Simulated("flight", 6)]
NAMES = ("heavy tails", "lens")


def test_each_mechanism_has_a_battery_of_its_own_beside_that_of_the_whole_filter(
    tmp_path: Path, ran: list[str]
) -> None:
    settings = TrialSettings(tmp_path, RobocentricSettings(), PredictionSettings())

    def ablation() -> list[dict[str, object]]:
        lines, notes = measure_ablation(
            tmp_path, ROWS, settings, names=NAMES, seeds=1, jobs=2, force=False
        )
        assert notes == []
        return lines

    lines = ablation()
    assert [line["name"] for line in lines] == ["nothing", *NAMES]
    assert [line["all"] for line in lines] == [None, 1.0, 1.0]
    assert [line["simulated walks"] for line in lines] == [None, 1.0, 1.0]
    assert len(ran) == 3 * len(ROWS)
    # A later call has all of it.
    assert ablation() == lines
    assert len(ran) == 3 * len(ROWS)
