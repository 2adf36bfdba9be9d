# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""``vislam solve``: the estimators offline, in this process."""

import argparse
import dataclasses
import time

from vislam_ros.cli.ending import PassResults, print_passes, require_complete, tell_written
from vislam_ros.cli.exit_codes import OK
from vislam_ros.cli.parameters import RunParameters, report_unused, run_parameters
from vislam_ros.cli.reading import read_input
from vislam_ros.cli.screen import progress_bar
from vislam_ros.core.filters.dead_reckoning import Prediction
from vislam_ros.core.filters.registry import estimator_named
from vislam_ros.core.step import SlamStep
from vislam_ros.core.tracking.refusals import RefusalCounts
from vislam_ros.data.drive import Drive
from vislam_ros.data.results.completeness import shortfall
from vislam_ros.data.results.summary import peak_rss_mb
from vislam_ros.data.results.writer import ResultWriter, pass_directory, refuse_used
from vislam_ros.data.solving import Solution, solve


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    started = time.monotonic()
    parameters = run_parameters(arguments)
    report_unused(parameters)
    if arguments.smooth:
        estimator_named(parameters.slam.estimator).require_smoothable()
    refuse_used(arguments.out, force=arguments.force)
    results: list[PassResults] = []
    refused = RefusalCounts()
    for number, drive in enumerate(
        read_input(arguments, parameters.reading, parameters.tracker), start=1
    ):
        directory = pass_directory(arguments.out, number)
        with ResultWriter(directory, force=arguments.force, started=started) as writer:
            writer.summary.drive = drive.name
            writer.set_parameters(_as_used(parameters))
            solution = _solve(drive, parameters, writer, smooth=arguments.smooth)
            refused.merge(solution.refused)
            _finish(writer, solution, refused)
        results.append((directory, writer.summary.as_dict()))
    print_passes(results)
    require_complete(results)
    tell_written(results, arguments.data)
    return OK


def _finish(writer: ResultWriter, solution: Solution, refused: RefusalCounts) -> None:
    """Write what stands at the end of a pass, with all that was refused up to there."""
    writer.set_landmarks(solution.landmarks)
    if solution.smoothed is not None and solution.smoothed.covariances is not None:
        writer.set_smoothed(solution.smoothed, solution.smoothed.covariances)
    summary = writer.summary
    summary.set_refused(refused)
    summary.resets = solution.summary["resets"]
    summary.verdict = solution.verdict
    summary.peak_rss_mb = peak_rss_mb()
    reason = shortfall(len(solution.trajectory), summary.refused, summary.refused_first)
    writer.finish(complete=reason is None, incomplete_reason=reason)


def _solve(
    drive: Drive, parameters: RunParameters, writer: ResultWriter, *, smooth: bool
) -> Solution:
    done = 0
    with progress_bar("solving", drive.steps) as update:

        def add_prediction(prediction: Prediction) -> None:
            writer.add_dead_reckoning(prediction.stamp, prediction.position, prediction.quaternion)

        def add_step(step: SlamStep) -> None:
            writer.add_step(step.position, step.quaternion, step.covariance, step.row())
            nonlocal done
            done += 1
            ends = smooth and done == drive.steps
            update(done, "smoothing" if ends else f"{step.landmarks} landmarks")

        return solve(
            drive,
            parameters.slam,
            parameters.prediction,
            given_map=parameters.given_map,
            smooth=smooth,
            on_prediction=add_prediction,
            on_step=add_step,
        )


def _as_used(parameters: RunParameters) -> dict[str, dict[str, object]]:
    """Every parameter that the estimators had, in the sections of the nodes."""
    return {
        "imu_prediction_node": dataclasses.asdict(parameters.prediction),
        "slam_node": dataclasses.asdict(parameters.slam),
    }
