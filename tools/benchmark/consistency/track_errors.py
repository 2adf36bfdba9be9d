# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How the disparities of a drive's tracks err, and whether their errors stay.

The smoothed motion and the left pixels of a track determine where its point lies, and so what its
disparity should be in every frame; the right pixels have no part in that. What is measured beside
it is the error, by the age of the track.
"""

import itertools
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation

from benchmark.consistency.track_points import BY_POINT, fitted_point
from benchmark.recorded_drive import record
from vislam_ros.core.filters.settings import ObservationSettings
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.observation import StereoObservation
from vislam_ros.core.settings import PredictionSettings
from vislam_ros.data.drive import Drive
from vislam_ros.data.solving import smoothed_trajectory

Array = NDArray[np.float64]

#: Bounds of the disparities by which tracks are grouped, pixels.
BOUNDS = (0.0, 5.0, 10.0, 20.0, 60.0)

# Frames that a track must have, and the frame to which its first error is compared.
_LATER = 5
# Its disparity must be known so well from its parallax, and its left pixels must fit, pixels.
_KNOWN, _FITS = 0.4, 1.0
# The right pixel has no part in where the point is.
_LEFT = np.array([1.0, 0.0, 1.0])


def disparity_errors(
    drive: Drive, slam_settings: ObservationSettings, prediction_settings: PredictionSettings
) -> list[dict[str, Any]]:
    """Measure the errors of the disparities of tracks that do not begin at a repeated pixel.

    Returns
    -------
    list of dict
        For each range of disparities ``from_px`` to ``to_px`` how many ``tracks`` were judged, the
        robust standard deviations of their errors in the first frame ``first_px``, of the change
        from one frame to the next ``step_px``, and of that over five frames ``later_px``.
    """
    recorded = record(drive, slam_settings, prediction_settings, smooth=True)
    smoothed = recorded.smoothed
    assert smoothed is not None
    poses = smoothed_trajectory(smoothed).T_world_body
    observation = StereoObservation(drive.camera, slam_settings.pixel_variance)
    frames: dict[int, list[int]] = defaultdict(list)
    points: dict[int, list[Array]] = defaultdict(list)
    copied: set[int] = set()
    for k, step in enumerate(recorded.filter_steps):
        keys = step.frame.keys
        copied.update(keys[step.frame.copied].tolist())
        seen = observation.image_points(step.frame.pixels)
        for key, y in zip(keys.tolist(), seen, strict=True):
            frames[key].append(k)
            points[key].append(y)
    judged = []
    for key, seen_in in frames.items():
        if len(seen_in) > _LATER and key not in copied:
            errors = _errors(drive.camera, poses[seen_in], np.array(points[key]))
            if errors is not None:
                judged.append((points[key][0][0] - points[key][0][1], errors))
    rows = []
    for low, high in itertools.pairwise(BOUNDS):
        of_range = [errors for disparity, errors in judged if low <= disparity < high]
        if of_range:
            rows.append(
                {
                    "from_px": low,
                    "to_px": high,
                    "tracks": len(of_range),
                    "first_px": _spread(np.array([errors[0] for errors in of_range])),
                    "step_px": _spread(np.concatenate([np.diff(errors) for errors in of_range])),
                    "later_px": _spread(np.array([e[_LATER] - e[0] for e in of_range])),
                }
            )
    return rows


def _errors(camera: StereoCamera, poses: Array, y: Array) -> Array | None:
    """Errors (n,) of the disparities of image points (n, 3); None where they are not known."""
    fitted = fitted_point(camera, se3.inverse(poses[0]) @ poses, y, _LEFT)
    if fitted is None:
        return None
    left = (y - fitted.expected)[:, _LEFT > 0]
    fit = float(np.sqrt(np.mean(left**2)))
    variance = BY_POINT @ np.linalg.solve(fitted.information, BY_POINT)
    known = max(fit, 0.2) * float(np.sqrt(variance))
    if fit > _FITS or known > _KNOWN:
        return None
    error: Array = (y - fitted.expected) @ BY_POINT
    return error


def _spread(values: Array) -> float:
    """Robust standard deviation about the median."""
    return float(median_abs_deviation(values, scale="normal"))
