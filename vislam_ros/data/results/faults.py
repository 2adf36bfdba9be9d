# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is missing in a result directory, or contradicts the rest of it."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vislam_ros.data.bags.integrity import verify_bag
from vislam_ros.data.files.inputs import check_regular, read_lines
from vislam_ros.data.results.landmark_map import point_cloud
from vislam_ros.data.results.reader import Results, read_results
from vislam_ros.data.trajectory import Trajectory, stamp_text
from vislam_ros.errors import VislamError


def result_faults(directory: Path) -> list[str]:
    """Hold each file of a result directory against the others, and give a line for each fault."""
    try:
        results = read_results(directory)
        return [
            *_contradictions(results),
            *_pose_faults(results),
            *_map_faults(results),
            *_other_faults(results),
        ]
    except VislamError as error:
        return [str(error).removeprefix(f"{directory}: ").removeprefix(f"{directory}/")]


def _contradictions(results: Results) -> Iterator[str]:
    """Of the summary and the steps with the poses."""
    summary, poses = results.summary, len(results.trajectory)
    if not summary.get("complete"):
        yield f"incomplete: {summary.get('incomplete_reason') or 'the run has not ended'}"
    if summary.get("steps") != poses:
        yield f"trajectory.tum holds {poses} poses, summary.json says {summary.get('steps')}"
    if (rows := len(results.steps["stamp"])) != poses:
        yield f"steps.csv holds {rows} rows for {poses} poses"
    if not results.parameters:
        yield "params.yaml is missing"


def _pose_faults(results: Results) -> Iterator[str]:
    """Of covariances, the prediction and the smoothed poses with the poses."""
    trajectory, smoothed = results.trajectory, results.smoothed
    yield from _covariance_faults("trajectory_covariance.csv", trajectory, results.covariances)
    predicted = results.dead_reckoning
    if predicted is None:
        yield "dead_reckoning.tum is missing or holds no pose"
    elif (
        predicted.stamps[0] > trajectory.stamps[0] or predicted.stamps[-1] < trajectory.stamps[-1]
    ):
        yield (
            f"dead_reckoning.tum goes from {_span(predicted)}, trajectory.tum from "
            f"{_span(trajectory)}"
        )
    if smoothed is None:
        if (results.directory / "smoothed_covariance.csv").exists():
            yield "smoothed.tum is missing or holds no pose, and smoothed_covariance.csv is there"
        return
    if len(smoothed) != len(trajectory):
        yield f"smoothed.tum holds {len(smoothed)} poses for the {len(trajectory)} that it smooths"
    assert results.smoothed_covariances is not None
    yield from _covariance_faults(
        "smoothed_covariance.csv", smoothed, results.smoothed_covariances
    )


def _covariance_faults(
    name: str, trajectory: Trajectory, covariances: NDArray[np.float64]
) -> Iterator[str]:
    known = int(np.isfinite(covariances).all(axis=(1, 2)).sum())
    if known != len(trajectory):
        yield f"{name} holds the covariances of {known} of {len(trajectory)} poses"


def _span(trajectory: Trajectory) -> str:
    return f"{stamp_text(trajectory.stamps[0])} to {stamp_text(trajectory.stamps[-1])} s"


def _map_faults(results: Results) -> Iterator[str]:
    """Of the map with the summary, and of its picture with the map."""
    if results.landmarks is None:
        yield "landmarks.npz is missing"
        return
    if results.summary.get("landmarks") != len(results.landmarks):
        yield (
            f"landmarks.npz holds {len(results.landmarks)} landmarks, summary.json says "
            f"{results.summary.get('landmarks')}"
        )
    cloud = results.directory / "landmarks.ply"
    if not cloud.exists():
        yield "landmarks.ply is missing"
        return
    check_regular(cloud)
    expected = point_cloud(results.landmarks)
    if cloud.stat().st_size != len(expected) or cloud.read_bytes() != expected:
        yield "landmarks.ply holds other points than landmarks.npz"


def _other_faults(results: Results) -> Iterator[str]:
    """Of what only some runs leave."""
    changes, said = results.directory / "parameter_changes.csv", "parameter_changes"
    rows = sum(1 for _ in read_lines(changes)) - 1 if changes.exists() else 0
    if rows != results.summary.get(said, rows):
        yield f"{changes.name} holds {rows} changes, summary.json says {results.summary[said]}"
    log = results.directory / "results.mcap"
    if log.exists():
        yield from verify_bag(log).faults
