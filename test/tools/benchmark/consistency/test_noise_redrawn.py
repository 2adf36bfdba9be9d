# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from benchmark.consistency.noise_redrawn import NoiseRedrawn, redraw
from benchmark.recorded_drive import first_steps, twist_errors
from numpy.typing import NDArray

from vislam_ros.core.filters.robocentric_settings import RobocentricSettings
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.evaluation.evaluate import compare
from vislam_ros.data.simulation.simulate import SimulationSettings, simulate
from vislam_ros.data.solving import solve
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

SETTINGS = SimulationSettings(
    steps=200,
    landmarks=900,
    pixel_noise_std=0.7,
    velocity_noise_std=0.3,
    angular_velocity_noise_std=0.03,
    gyro_bias=(0.01, -0.01, 0.005),
    frozen_share=0.1,
    seed=7,
)


@pytest.fixture(scope="module")
def drive() -> Drive:
    return simulate(SETTINGS).drive


@pytest.fixture(scope="module")
def truth(drive: Drive) -> Trajectory:
    assert drive.ground_truth is not None
    return drive.ground_truth


@pytest.fixture(scope="module")
def noise(drive: Drive, truth: Trajectory) -> NoiseRedrawn:
    return NoiseRedrawn(drive, truth, RobocentricSettings())


@pytest.fixture(scope="module")
def drawn(noise: NoiseRedrawn) -> Drive:
    return noise.draw(np.random.default_rng(0), twists=True)


def test_the_noise_is_found(noise: NoiseRedrawn) -> None:
    assert noise.pixel_std == pytest.approx(0.7, rel=0.03)
    assert noise.twist_std == pytest.approx([0.3, 0.03], rel=0.2)
    assert noise.gyro_bias == pytest.approx(SETTINGS.gyro_bias, abs=4 * 0.03 / 200**0.5)


def test_what_slides_keeps_its_pixels_and_all_else_gets_others(
    noise: NoiseRedrawn, drive: Drive, drawn: Drive
) -> None:
    same = np.all(drawn.pixels == drive.pixels, axis=1)
    # Those that slide for a few frames only may pass for noise.
    assert 1 - SETTINGS.outlier_share - 0.01 < noise.redrawn_share < 0.998
    assert 1 - np.mean(same) == pytest.approx(noise.redrawn_share, abs=0.01)


def frozen_steps(drive: Drive) -> NDArray[np.int64]:
    solution = solve(drive, RobocentricSettings(), PredictionSettings())
    return np.flatnonzero(solution.steps["frozen"])


def test_the_same_steps_are_frozen(drive: Drive, drawn: Drive) -> None:
    frozen = frozen_steps(drive)
    assert len(frozen) == pytest.approx(0.1 * SETTINGS.steps, abs=2)
    np.testing.assert_array_equal(frozen_steps(drawn), frozen)


def test_the_new_noise_is_as_large_as_the_old_and_independent_of_it(
    drive: Drive, truth: Trajectory, drawn: Drive
) -> None:
    # From the first frozen step on other points stand behind the tracks.
    before = slice(drive.offsets[frozen_steps(drive)[0]])
    change = drawn.pixels[before].astype(float) - drive.pixels[before]
    spread = 1.4826 * np.median(np.abs(change))
    assert spread == pytest.approx(np.sqrt(2) * 0.7, rel=0.1)
    again = NoiseRedrawn(drawn, truth, RobocentricSettings())
    assert again.pixel_std == pytest.approx(0.7, rel=0.03)
    _, old = twist_errors(drive, truth)
    _, new = twist_errors(drawn, truth)
    assert np.std(new, axis=0) == pytest.approx(np.std(old, axis=0), rel=0.3)
    assert np.all(np.abs(np.corrcoef(old.T, new.T)[:6, 6:]) < 0.3)


def test_twists_stay_where_only_pixels_are_drawn(noise: NoiseRedrawn, drive: Drive) -> None:
    drawn = noise.draw(np.random.default_rng(0), twists=False)
    np.testing.assert_array_equal(drawn.twists, drive.twists)


def test_a_drive_whose_tracks_are_too_short_to_tell_is_refused(
    drive: Drive, truth: Trajectory
) -> None:
    with pytest.raises(VislamError, match="simulated: no track of 5 frames"):
        NoiseRedrawn(first_steps(drive, 3), truth, RobocentricSettings())


def test_the_drive_stands_beside_the_means_of_the_others(drive: Drive, truth: Trajectory) -> None:
    report = redraw(
        drive,
        truth,
        RobocentricSettings(),
        PredictionSettings(),
        range(2),
        on_progress=lambda what: None,
    )
    itself, *others = report["runs"]
    solution = solve(drive, RobocentricSettings(), PredictionSettings())
    expected = compare(truth, solution.trajectory, solution.trajectory.covariances)
    assert itself["nees"] == expected["nees_per_dof"]
    assert itself["ate_m"] == expected["ate_m"]["rmse"]
    assert [row["name"] for row in others] == ["other pixels", "other pixels and twists"]
    for row in others:
        nees = [one["nees"] for one in report["drives"] if one["name"] == row["name"]]
        assert len(set(nees)) == row["drives"] == 2
        assert row["nees"] == pytest.approx(np.mean(nees))
        assert (row["nees_least"], row["nees_greatest"]) == (min(nees), max(nees))
