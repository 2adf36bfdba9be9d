# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a drive is, in figures."""

from typing import Any

import numpy as np

from vislam_ros.data.drive import Drive
from vislam_ros.data.trajectory import NANOSECONDS


def facts_of(drive: Drive) -> dict[str, Any]:
    """Figures of a drive, in SI units and pixels; None for what is not known."""
    counts = np.diff(drive.offsets)
    lengths = np.unique(drive.ids, return_counts=True)[1]
    disparity = (drive.pixels[:, 0] - drive.pixels[:, 2]).astype(float)
    with np.errstate(divide="ignore"):
        depth = drive.camera.fx_baseline / disparity[disparity > 0]
    return {
        "steps": drive.steps,
        "duration_s": drive.duration,
        "frame_rate_hz": _rate(drive.feature_stamps),
        "motion_samples": len(drive.twists),
        "motion_rate_hz": _rate(drive.twist_stamps),
        "measures_velocity": drive.measures_velocity,
        "path_m": _path(drive),
        "speed_max_m_s": _largest(drive.twists[:, :3]),
        "turn_rate_max_rad_s": _largest(drive.twists[:, 3:]),
        "tracks": len(lengths),
        "observations": len(drive.ids),
        "observations_a_frame": [
            int(counts.min()) if len(counts) else 0,
            *_middle(counts),
            int(counts.max(initial=0)),
        ],
        "track_length_mean": float(lengths.mean()) if len(lengths) else None,
        "disparity_px": _quantiles(disparity),
        "depth_m": _quantiles(depth),
        "image_size": list(drive.image_size),
        "focal_length_px": [drive.camera.fx, drive.camera.fy],
        "principal_point_px": [drive.camera.cx, drive.camera.cy],
        "baseline_m": drive.camera.baseline,
        "states_noise": drive.noise is not None,
        "ground_truth_poses": 0 if drive.ground_truth is None else len(drive.ground_truth),
        "refused": dict(drive.refused.counts),
    }


def _rate(stamps: "np.ndarray[Any, Any]") -> float | None:
    return float(NANOSECONDS / np.median(np.diff(stamps))) if len(stamps) > 1 else None


def _middle(values: "np.ndarray[Any, Any]") -> list[int]:
    return [int(np.median(values))] if len(values) else [0]


def _quantiles(values: "np.ndarray[Any, Any]") -> list[float] | None:
    """5th, 50th and 95th percentiles."""
    return np.percentile(values, [5.0, 50.0, 95.0]).tolist() if len(values) else None


def _largest(vectors: "np.ndarray[Any, Any]") -> float | None:
    sizes = np.linalg.norm(vectors, axis=1)
    known = sizes[np.isfinite(sizes)]
    return float(known.max()) if len(known) else None


def _path(drive: Drive) -> float | None:
    """Length of the path, metres, of the true poses or of the velocities."""
    if drive.ground_truth is not None and len(drive.ground_truth) > 1:
        steps = np.diff(drive.ground_truth.positions, axis=0)
        return float(np.sum(np.linalg.norm(steps, axis=1)))
    if not drive.measures_velocity:
        return None
    tau = np.diff(drive.twist_stamps) / NANOSECONDS
    return float(np.sum(tau * np.linalg.norm(drive.twists[1:, :3], axis=1)))
