# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the files of a result directory are called."""

#: All that a run, its evaluation and its pictures leave in a result directory.
OWNED_FILES = (
    "trajectory.tum",
    "trajectory_covariance.csv",
    "dead_reckoning.tum",
    "smoothed.tum",
    "smoothed_covariance.csv",
    "steps.csv",
    "parameter_changes.csv",
    "landmarks.npz",
    "landmarks.ply",
    "params.yaml",
    "summary.json",
    "results.mcap",
    *(
        f"{name}.{kind}"
        for name in ("trajectory", "steps", "estimates", "errors")
        for kind in ("png", "svg")
    ),
    "report.html",
    "findings.json",
)
