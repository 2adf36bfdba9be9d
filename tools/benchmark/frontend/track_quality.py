# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How good tracks are by themselves: against the one motion that most of them agree on.

No truth is so exact that it tells hundredths of a pixel. So the camera's motion of each step is
fitted to the tracks, robustly, and what is left over is compared with the noise that they state:
the median of its square is that of chi-square with three degrees of freedom, if that is right.
"""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.warp import warp
from vislam_ros.frontend.tracker import Tracked

Array = NDArray[np.float64]

# Median of chi-square with three degrees of freedom, and what one in a thousand exceeds.
_MEDIAN, _ONE_IN_A_THOUSAND = 2.366, 16.27
_ROUNDS = 8
_FEWEST = 12
# Both rows of an observation are one, so its mean has half the variance.
_ROWS = np.diag([1.0, 1.0, 0.5])


def quality(camera: StereoCamera, frames: list[Tracked]) -> dict[str, Any]:
    """Observations, lengths of tracks, and residuals of one step over the stated noise.

    Parameters
    ----------
    camera : StereoCamera
    frames : list of Tracked

    Returns
    -------
    dict
        ``observations`` a frame (median), ``length`` of the track of an observation (mean),
        ``noise_px`` stated (median), ``whitened`` (1 is right) and ``beyond``, the share that one
        in a thousand should exceed.
    """
    squares = [_step(camera, before, now) for before, now in itertools.pairwise(frames)]
    every = np.concatenate([np.zeros(0), *squares])
    _, lengths = np.unique(np.concatenate([f.ids for f in frames]), return_counts=True)
    return {
        "observations": int(np.median([len(frame.ids) for frame in frames])),
        "length": float(np.average(lengths, weights=lengths)),
        "noise_px": float(np.median(np.concatenate([f.noise for f in frames]))),
        "whitened": float(np.sqrt(np.median(every) / _MEDIAN)) if len(every) else None,
        "beyond": float(np.mean(every > _ONE_IN_A_THOUSAND)) if len(every) else None,
    }


def _step(camera: StereoCamera, before: Tracked, now: Tracked) -> Array:
    """Squared whitened residuals (n,) of the points that two frames share."""
    _, a, b = np.intersect1d(before.ids, now.ids, return_indices=True)
    if len(a) < _FEWEST:
        return np.zeros(0)
    y, seen = _image_points(before.pixels[a]), _image_points(now.pixels[b])
    noise, later = (
        frame.noise[rows].astype(float) ** 2 for frame, rows in ((before, a), (now, b))
    )
    T_old_new = np.eye(4)
    for last in (*[False] * _ROUNDS, True):
        w = warp(camera, y, T_old_new)
        residuals = np.where(w.ahead[:, None], seen - w.y, 0)
        S = noise[:, None, None] * (w.F_y @ _ROWS @ w.F_y.transpose(0, 2, 1))
        weights = np.linalg.inv(S + later[:, None, None] * _ROWS)
        squares = np.einsum("ni,nij,nj->n", residuals, weights, residuals)
        if last:
            break
        # Student's t with one degree of freedom, so that strays do not count.
        weights *= (w.ahead / (1 + squares / 3))[:, None, None]
        H = np.einsum("nai,nab,nbj->ij", w.G, weights, w.G)
        g = np.einsum("nai,nab,nb->i", w.G, weights, residuals)
        T_old_new = T_old_new @ se3.exp(np.linalg.solve(H, g))
    return squares[w.ahead]


def _image_points(pixels: NDArray[np.float32]) -> Array:
    u_left, v_left, u_right, v_right = pixels.astype(float).T
    return np.stack([u_left, u_right, (v_left + v_right) / 2], axis=1)
