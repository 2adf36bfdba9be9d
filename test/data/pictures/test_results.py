# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from step_rows import step_row

from vislam_ros.core.geometry import se3
from vislam_ros.data.pictures import palette
from vislam_ros.data.pictures.errors import draw_errors
from vislam_ros.data.pictures.estimates import draw_estimates
from vislam_ros.data.pictures.overview import draw_trajectory
from vislam_ros.data.pictures.results import plot_results
from vislam_ros.data.pictures.steps import draw_steps
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.data.results.writer import ResultWriter
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError


def lines(axes: object) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}  # type: ignore[attr-defined]


def outlines(figure: Figure) -> tuple[str, list[np.ndarray]]:
    (ellipses,) = figure.axes[0].collections
    return str(ellipses.get_label()), [np.asarray(path.vertices) for path in ellipses.get_paths()]


def test_the_picture_from_above_shows_what_there_is(
    round_results: Results, round_drive: Trajectory, moved_round: Trajectory
) -> None:
    figure = draw_trajectory(round_results, moved_round)
    above, heights = figure.axes
    drawn = lines(above)
    errors = {name.split(",")[0]: name for name in drawn}
    assert set(errors) == {
        "estimate",
        "dead reckoning",
        "reference",
        "landmarks (3)",
        "start",
        "end",
    }
    assert errors["estimate"] == "estimate, ATE 0.000 m"
    np.testing.assert_array_equal(drawn["estimate, ATE 0.000 m"], round_drive.positions[:, :2])
    np.testing.assert_allclose(drawn["reference"], round_drive.positions[:, :2], atol=1e-9)
    np.testing.assert_array_equal(drawn["start"], round_drive.positions[:1, :2])
    np.testing.assert_array_equal(drawn["end"], round_drive.positions[-1:, :2])
    assert (above.get_xlabel(), above.get_ylabel()) == ("x [m]", "y [m]")
    assert "round" in above.get_title()
    assert "(SE(3))" in above.get_title()
    profile = np.asarray(heights.get_lines()[0].get_xydata())
    np.testing.assert_allclose(profile[:, 0], 0.1 * np.arange(60), atol=1e-12)
    np.testing.assert_array_equal(profile[:, 1], round_drive.positions[:, 2])


@pytest.mark.parametrize("laying", ["se3", "yaw", "none", "first"])
def test_the_error_that_is_told_is_the_distance_of_what_is_drawn(
    round_results: Results, moved_round: Trajectory, laying: str
) -> None:
    above, heights = draw_trajectory(round_results, moved_round, laying).axes  # type: ignore[arg-type]
    drawn = lines(above)
    plane = {name.split(",")[0]: xy for name, xy in drawn.items()}
    height = {
        name: np.asarray(line.get_ydata(), dtype=float)
        for name, line in zip(
            ("estimate", "dead reckoning", "reference"), heights.get_lines(), strict=True
        )
    }
    for name in ("estimate", "dead reckoning"):
        (label,) = (label for label in drawn if label.startswith(name))
        told = float(label.split()[-2])
        flat = plane[name] - plane["reference"]
        squares = np.sum(flat**2, axis=1) + (height[name] - height["reference"]) ** 2
        assert told == pytest.approx(float(np.sqrt(squares.mean())), rel=0.006, abs=0.00051)
        assert ("ATE" in label) == (laying != "first")


def test_paths_that_lie_on_each_other_are_all_seen(
    round_results: Results, round_drive: Trajectory
) -> None:
    results = replace(round_results, smoothed=round_drive)
    for axes in draw_trajectory(results, round_drive).axes:
        from_below = sorted(axes.get_lines(), key=lambda line: line.get_zorder())
        widths = {
            name: next(line.get_linewidth() for line in from_below if line.get_color() == color)
            for name, color in (
                ("estimate", palette.ESTIMATE),
                ("smoothed", palette.SMOOTHED),
                ("reference", palette.REFERENCE),
            )
        }
        of_paths = {palette.ESTIMATE, palette.SMOOTHED, palette.REFERENCE}
        paths = [line for line in from_below if line.get_color() in of_paths]
        assert list(widths.values()) == sorted(widths.values(), reverse=True)
        assert [line.get_color() for line in paths if line.get_marker() == "None"][-3:] == [
            palette.ESTIMATE,
            palette.SMOOTHED,
            palette.REFERENCE,
        ]
        assert paths[-1].get_linestyle() == "--"


def test_a_gyroscope_alone_is_said_to_have_no_dead_reckoning(
    round_results: Results, round_drive: Trajectory
) -> None:
    standing = replace(round_drive, positions=np.zeros((len(round_drive), 3)))
    drawn = lines(draw_trajectory(replace(round_results, dead_reckoning=standing)).axes[0])
    assert "no dead reckoning: no velocity" in drawn


def test_ellipses_hold_95_percent_of_the_position(
    round_results: Results, round_drive: Trajectory
) -> None:
    label, drawn = outlines(draw_trajectory(round_results))
    assert label == "95% ellipses"
    outline = drawn[-1] - round_drive.positions[-1, :2]
    R = round_drive.T_world_body[-1, :3, :3]
    Sigma = (R @ np.diag([4.0, 1.0, 0.25]) @ R.T)[:2, :2]
    squares = np.einsum("ni,ij,nj->n", outline, np.linalg.inv(Sigma), outline)
    np.testing.assert_allclose(squares, -2.0 * np.log(0.05), rtol=1e-9)


def test_small_ellipses_are_enlarged_and_it_is_told(round_results: Results) -> None:
    covariances = round_results.covariances
    _, drawn = outlines(draw_trajectory(round_results))
    covariances *= 1e-4
    label, enlarged = outlines(draw_trajectory(round_results))
    times = float(label.removeprefix("95% ellipses, ").removesuffix(" times as large"))
    assert times > 10.0
    sizes = [np.ptp(each[-1], axis=0) for each in (drawn, enlarged)]
    np.testing.assert_allclose(sizes[1], 0.01 * times * sizes[0], rtol=1e-9)


def test_a_far_landmark_does_not_shrink_the_picture(round_results: Results) -> None:
    above, _ = draw_trajectory(round_results).axes
    assert max(np.abs([*above.get_xlim(), *above.get_ylim()])) < 100.0
    assert len(lines(above)["landmarks (3)"]) == 2


def test_the_steps_are_drawn_without_frozen_ones_in_the_nis(round_results: Results) -> None:
    figure = draw_steps(round_results)
    nis = lines(figure.axes[2])
    assert len(nis["each step"]) == np.count_nonzero(round_results.steps["nis_dof"])
    assert {"mean 1.00", "100% inside"} <= set(nis)


@pytest.mark.parametrize(("late", "words"), [(1, "1 step higher"), (2, "2 steps higher")])
def test_steps_beyond_the_picture_are_counted(
    round_results: Results, late: int, words: str
) -> None:
    round_results.steps["ms"][:late] = 500.0
    round_results.steps["ms"][late:] = 1.0
    steps = {name: np.tile(column, 10) for name, column in round_results.steps.items()}
    steps["ms"][60:] = 1.0
    assert words in lines(draw_steps(replace(round_results, steps=steps)).axes[3])


def test_errors_stand_in_the_axes_of_the_body(
    round_results: Results, round_drive: Trajectory, moved_round: Trajectory
) -> None:
    # The truth is that much ahead, to the left and turned from the second pose on.
    xi = np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.01])
    T = moved_round.T_world_body
    T[1:] = T[1:] @ se3.exp(xi)
    figure = draw_errors(round_results, Trajectory.from_matrices(round_drive.stamps, T))
    for k, axes in enumerate(figure.axes[:6]):
        (error,) = (line for line in axes.get_lines() if str(line.get_label()).startswith("error"))
        unit = 1.0 if k < 3 else np.rad2deg(1.0)
        drawn = np.asarray(error.get_ydata(), dtype=float)
        np.testing.assert_allclose(drawn[1:], -xi[k] * unit, atol=1e-9)
    (band,) = figure.axes[0].collections
    corners = np.asarray(band.get_paths()[0].vertices)
    assert corners[:, 1].max() == pytest.approx(6.0)  # 3 sigma
    assert figure.axes[6].get_ylabel() == "NEES / 6"


def test_what_changes_among_the_estimates_is_drawn_with_its_band(round_results: Results) -> None:
    figure = draw_estimates(round_results)
    assert figure is not None
    (axes,) = figure.axes
    assert "gyro bias" in axes.get_ylabel()
    np.testing.assert_array_equal(
        axes.get_lines()[0].get_ydata(), round_results.steps["gyro_bias_x"]
    )
    assert len(axes.collections) == 3
    for name in ("gyro_bias_x", "gyro_bias_y"):
        round_results.steps[name][:] = 0.0
    assert draw_estimates(round_results) is None


@pytest.mark.parametrize("kind", ["png", "svg"])
def test_pictures_are_written_and_not_overwritten(
    round_results: Results, round_drive: Trajectory, kind: str
) -> None:
    pictures = plot_results(round_results, round_drive, picture_format=kind)  # type: ignore[arg-type]
    names = ("trajectory", "steps", "estimates", "errors")
    assert [path.name for path in pictures] == [f"{name}.{kind}" for name in names]
    before = [path.read_bytes() for path in pictures]
    for content in before:
        assert content.startswith(b"\x89PNG" if kind == "png" else b"<?xml")
    with pytest.raises(VislamError, match=rf"trajectory.{kind}: exists already"):
        plot_results(round_results, picture_format=kind)  # type: ignore[arg-type]
    again = plot_results(round_results, round_drive, force=True, picture_format=kind)  # type: ignore[arg-type]
    assert again == pictures
    assert [path.read_bytes() for path in pictures] == before


def test_a_run_without_steps_or_motion_has_its_picture(tmp_path: Path) -> None:
    with ResultWriter(tmp_path / "results") as writer:
        pose = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        writer.add_step(*pose, np.zeros((6, 6)), step_row(10**9))
        writer.finish(complete=True)
    (writer.directory / "steps.csv").unlink()
    (picture,) = plot_results(read_results(writer.directory), output=tmp_path / "pictures")
    assert picture == tmp_path / "pictures" / "trajectory.png"
    assert picture.is_file()
