# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
import pytest
from benchmark.consistency.track_errors import disparity_errors

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate


def errors(**noise: Any) -> list[dict[str, float]]:
    simulated = simulate(
        SimulationSettings(steps=150, landmarks=900, outlier_share=0.0, frozen_share=0.1, **noise)
    )
    rows = disparity_errors(simulated.drive, RobocentricSettings(), PredictionSettings())
    assert sum(row["tracks"] for row in rows) > 100
    assert all(0 <= row["from_px"] < row["to_px"] for row in rows)
    return [row for row in rows if row["tracks"] > 30]


def test_errors_that_stay_are_told_from_those_that_change() -> None:
    for row in errors(pixel_noise_std=0.05, disparity_offset_std=0.6):
        assert row["first_px"] == pytest.approx(0.6, rel=0.3)
        # Two pixels change by 0.05 each from one frame to the next.
        assert row["step_px"] == pytest.approx(0.1, rel=0.3)
        assert row["later_px"] < 0.2


def test_white_errors_change_by_as_much_as_they_are() -> None:
    for row in errors(pixel_noise_std=0.5):
        assert row["first_px"] == pytest.approx(0.5 * np.sqrt(2), rel=0.3)
        assert row["step_px"] == pytest.approx(0.5 * 2, rel=0.3)
