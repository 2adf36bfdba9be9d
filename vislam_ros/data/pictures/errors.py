# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the pose axis by axis with three standard deviations, and their NEES."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vislam_ros.data.evaluation.association import associate
from vislam_ros.data.evaluation.consistency import (
    consistency_figures,
    nees_bounds,
    normalised_errors,
    pose_errors,
)
from vislam_ros.data.pictures import palette
from vislam_ros.data.results.reader import Results
from vislam_ros.data.trajectory import Trajectory

Array = NDArray[np.float64]

AXES = ("forward [m]", "lateral [m]", "vertical [m]", "roll [°]", "pitch [°]", "yaw [°]")


def axis_errors(results: Results, reference: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Errors of the poses that a reference has, both first poses being the same.

    Returns
    -------
    tuple of ndarray
        Seconds (n,) from the estimate's first pose; errors (n, 6), estimate less reference in the
        body axes, metres and degrees; their standard deviations (n, 6); NEES by its degrees of
        freedom (n,). NaN where the covariance is not known.
    """
    i, j = associate(reference, results.trajectory)
    T_reference, T_estimate = reference.T_world_body[i], results.trajectory.T_world_body[j]
    units = np.array([1.0, 1.0, 1.0, *np.rad2deg(np.ones(3))])
    covariances = results.covariances[j]
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    seconds = (results.trajectory.stamps[j] - results.trajectory.stamps[0]) * 1e-9
    return (
        seconds,
        -pose_errors(T_reference, T_estimate) * units,
        np.sqrt(np.maximum(variances, 0.0)) * units,
        normalised_errors(T_reference, T_estimate, covariances),
    )


def draw_errors(results: Results, reference: Trajectory) -> Figure:
    """Draw the errors of position and attitude, as a figure.

    The first poses are laid onto each other, as a filter that starts at the origin sees it; so
    its covariance speaks of these errors, and of no others.
    """
    seconds, errors, std, nees = axis_errors(results, reference)
    figure = Figure(figsize=(10.0, 12.0), layout=palette.layout())
    *rows, consistency = figure.subplots(7, sharex=True)
    for axes, name, error, sigma in zip(rows, AXES, errors.T, std.T, strict=True):
        known = np.isfinite(sigma)
        if known.any():
            inside = float(np.mean(np.abs(error[known]) <= 3 * sigma[known]))
            axes.fill_between(
                seconds,
                -3 * sigma,
                3 * sigma,
                color=palette.ESTIMATE,
                alpha=0.15,
                linewidth=0,
                label=rf"± 3 $\sigma$ ({inside:.0%} inside)",
            )
        rms = float(np.sqrt(np.mean(error**2)))
        axes.plot(
            seconds, error, color=palette.ESTIMATE, linewidth=0.9, label=f"error, RMS {rms:.2g}"
        )
        axes.axhline(0.0, color=palette.REFERENCE, linewidth=0.6)
        axes.set_ylabel(name)
    figures = consistency_figures(nees)
    mean = figures["nees_per_dof"]
    if mean is not None:
        low, high = nees_bounds()
        consistency.axhspan(low, high, color=palette.START, alpha=0.2, linewidth=0, label="95 %")
        consistency.plot(
            seconds, nees, color=palette.ESTIMATE, linewidth=0.9, label=f"mean {mean:.2f}"
        )
        consistency.set_yscale("log")
        palette.plain_numbers(consistency.yaxis)
    consistency.set(ylabel="NEES / 6", xlabel="time [s]")
    title = f"{palette.title(results)}\nerrors in body axes, first pose laid onto the reference's"
    palette.finish_series(figure, title)
    return figure
