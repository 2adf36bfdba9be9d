# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The noise of tracks, learned as the filter goes.

*Level.* One scale of the prior variances V for the whole drive, by which the innovations are as
large as they are expected to be: a stochastic approximation (Robbins and Monro, *A stochastic
approximation method*, 1951) of ``E[r^T S^-1 r] = dim r``, the condition of covariance matching
(Mehra, *Approaches to adaptive filtering*, 1972). The noise is only a part of S, so that a change
of the level by a factor changes the left side by less: by ``tr(S^-1 R)``, over which each step is
divided (Fisher's scoring). A point has one row in both images; where the rows of the first tracks
differ by more than the prior, the level begins there. They may agree by far better than one frame
agrees with the next, so they never lower it.

*Quality.* Most tracks are better than the level and some are far worse: on real drives the errors
of all tracks together have heavy tails, those of one track much less so. Each track has a scale of
its own, whose prior counts as a few numbers observed: the scale mixture that makes Student's t
(Lange, Little and Taylor, *Robust statistical modeling using the t distribution*, 1989). With
``w = S^-1 r``, ``D = S^-1`` and noise ``R = s R_0`` of the numbers of one track, ::

    E[n^T R_0^-1 n] = s^2 w^T R_0 w + s (dim r - s tr(D_ii R_0))

*Offset.* The matching of left and right finds the disparity wrong by the same amount for all the
life of a track (on KITTI by 0.4 to 1.2 pixels, where it changes by 0.06 to 0.25 from frame to
frame). Such a disparity can be observed only once: afterwards the right pixel repeats what is
known. Whether a drive is one of these shows in the disparity's innovations. Of one and the one
before it, the second is within half of the first's size of the first in a share of the tracks
that is 0.17 where the errors are white, 0.27 where they are and only the first disparity was used,
and 0.64 where they have a correlation rho of 0.95 (the ratio of two such normal variables is
Cauchy about rho, with scale ``sqrt(1 - rho^2)``); on KITTI it is 0.42 to 0.67.

*What errors have in common.* Where they stay, those of lens and rig are among them, which all
tracks share, and the covariance that is worked out as if they were white is five to ten times too
small (NEES on the recorded drives). So ten observations tell as much as one that is independent
where offsets are proven, one where errors are white, and by the same share of the powers of ten
between.

*Stated noise.* A front end may know the noise of each observation from its image. Then V has that
size for each, and an offset is as large as the noise of a disparity: what it states may well stay
for the life of a track. What it cannot know, such as what rectification has left, is alike for
all: a level L > 1 adds ``L - 1`` times the mean of the stated variances to each, and is still the
factor on their mean.

All look back only, so the noise is the same live and offline.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.linalg.linear_update import diagonal_blocks
from vislam_ros.core.linalg.small_inverse import small_inverse
from vislam_ros.core.noise.frame_rate import FrameRate
from vislam_ros.core.noise.twist_noise import MEDIAN_TO_STD

Array = NDArray[np.float64]

# Memory of the level [s], and the evidence that its prior counts as: so many frames, each as good
# as the next at any rate.
_MEMORY = 30.0
_PRIOR_FRAMES = 25
# First tracks whose rows tell where to begin.
_ENOUGH_ROWS = 20
# The largest change of the level's logarithm in a frame, and its bounds: a hundredth and a hundred
# times the prior standard deviation.
_LARGEST_CHANGE = 0.3
_LIMIT = math.log(1e4)
# The prior of a track's own scale counts as this many numbers observed; so does the track's of an
# observation's.
_PRIOR_NUMBERS = 6.0
# A disparity's error stays where it changes by less than this share of itself; see above for the
# shares of errors that do.
_STAYS = 0.5
# Of the share of disparity errors that stay: its start, just short of proof, the number of errors
# that it counts for and those remembered at most, and where offsets are taken for proven.
_FIRST_SHARE = 0.34
_PRIOR_ERRORS = 200
_ERRORS_REMEMBERED = 5000
_SHARE_OF_OFFSETS = 0.35
# The share where errors are white, and how many observations are as good as one where they stay.
_WHITE_SHARE = (math.atan(1 + _STAYS) - math.atan(1 - _STAYS)) / math.pi
_WHERE_ERRORS_STAY = 10.0
# On such drives a track's own scale is known only roughly, and a few tracks are far worse.
_WIDER_GATE = 1.5
# The offset grows with the disparity, by this share of it.
_RELATIVE_OFFSET = 0.02

# From which scale on, over its track's, an observation is far off: of right ones 1 in 17.
_FAR_OFF = 1.5
# How often an observation's scale and the estimate are found from each other at most.
_ROUNDS = 6

# Which of (u_left, u_right, v) a known landmark's observation adds.
_ALL = np.array([0, 1, 2])
_WITHOUT_RIGHT = np.array([0, 2])


class TrackNoise:
    """Running noise of the observations, by the active landmarks of a filter in their order.

    Parameters
    ----------
    variances : ndarray, (3,)
        Prior variances of ``(u_left, u_right, v)``, square pixels.
    offset_std : float
        Standard deviation of the offset that a track's disparity keeps, where a drive has one,
        pixels; 0 where none is looked for.
    rate : FrameRate
        Of the frames, kept up to date by the filter.
    learns : bool
        Whether it learns, or the variances are held.

    Attributes
    ----------
    level : float
        Scale of the variances for all tracks.
    is_stated : bool
        Whether the source of the present frame states the noise of its observations.
    usual_factor : float
        Mean of the factors that it puts on the prior variances.
    """

    def __init__(self, variances: Array, offset_std: float, rate: FrameRate, *, learns: bool):
        self._rate = rate
        self._variances = variances
        self._offset_variance = offset_std**2
        self._learns = learns
        self._frames = 0
        self._staying, self._errors = _FIRST_SHARE, _PRIOR_ERRORS
        # By landmark: E[n^T R_0^-1 n] and numbers observed, the prior's included; the last
        # frame's innovation of the disparity, NaN where there was none.
        self._noise: Array = np.empty(0)
        self._observed: Array = np.empty(0)
        self._last_error: Array = np.empty(0)
        self.level = 1.0
        self.is_stated, self.usual_factor = False, 1.0

    def factors(self, noise: Array | None, count: int) -> Array:
        """Factors (n,) on the prior variances of so many observations of a frame, at this level.

        Parameters
        ----------
        noise : ndarray, (n,), or None
            Standard deviations as the source states them, pixels.
        count : int
        """
        self.is_stated = noise is not None
        if noise is None:
            return np.ones(count)
        factors = np.square(noise) / self._variances[0]
        if count:
            self.usual_factor = float(factors.mean())
        common = max(self.level - 1.0, 0.0)
        return (factors + common * self.usual_factor) / (1.0 + common)

    def tell(self, variances: Array, offset_std: float, *, learns: bool) -> None:
        """Go on with other priors; variances that are new count as they are told, at level 1."""
        if np.any(variances != self._variances):
            self._variances, self.level = variances, 1.0
        self._offset_variance = offset_std**2
        self._learns = learns

    @property
    def has_offsets(self) -> bool:
        """Whether disparities keep an offset for the life of their track."""
        return self._offset_variance > 0 and self._staying > _SHARE_OF_OFFSETS

    @property
    def observations_per_independent(self) -> float:
        """How many observations tell as much of what they have in common as an independent one."""
        above_white = (self._staying - _WHITE_SHARE) / (_SHARE_OF_OFFSETS - _WHITE_SHARE)
        return float(_WHERE_ERRORS_STAY ** min(max(above_white, 0.0), 1.0))

    @property
    def components(self) -> NDArray[np.int64]:
        """Which of ``(u_left, u_right, v)`` say anything new of a known landmark."""
        return _WITHOUT_RIGHT if self.has_offsets else _ALL

    def of_new_tracks(self, y: Array, factors: Array | float = 1.0) -> Array:
        """Covariances (n, 3, 3) of the first image points (n, 3) of tracks, square pixels."""
        variances = self.level * np.broadcast_to(factors, len(y))[:, None] * self._variances
        noise = np.zeros((len(y), 3, 3))
        noise.reshape(-1, 9)[:, ::4] = variances
        if self.has_offsets:
            # Left and right go together, but for the offset.
            noise[:, :2, :2] = noise[:, :1, :1]
            noise[:, 1, 1] += self._offset_variances(y, variances)
        return noise

    def gate(self, chi2_gate: float) -> float:
        """Bound of the squared distances of innovations: wider where tracks differ in quality."""
        return _WIDER_GATE * chi2_gate if self.has_offsets else chi2_gate

    def variances(self, indices: NDArray[np.int64], factors: Array | float = 1.0) -> Array:
        """Variances (n, 3) of the image points of known landmarks, square pixels."""
        return self.level * (self._scale(indices) * factors)[:, None] * self._variances

    def with_tails(
        self, indices: NDArray[np.int64], variances: Array, inverse: Array, weighted: Array
    ) -> Array:
        """Variances (n, 3) of observations, larger where one is far off for its track.

        Each is judged by its innovation given all the others, as the gate does.

        Parameters
        ----------
        indices : ndarray of int64, (n,)
            Indices of the landmarks seen, all different.
        variances : ndarray, (n, 3)
            With which S was worked out, square pixels.
        inverse : ndarray, (n r, n r)
            ``S^-1``, 1 / square pixels, r numbers for each landmark: those of ``components``.
        weighted : ndarray, (n r,)
            ``S^-1 r``, 1 / pixels.
        """
        if not self._learns:
            return variances
        used = self.components
        blocks = diagonal_blocks(inverse, len(used))
        own, w = self._scale(indices), weighted.reshape(-1, len(used))
        larger: Array = _with_tails(blocks, w, variances, used, own)
        return larger

    def expected(self, variances: Array, y: Array) -> Array:
        """Variances (n, 3) that innovations at image points (n, 3) add to those of the state."""
        if not self.has_offsets:
            return variances
        expected = variances.copy()
        expected[:, 1] += self._offset_variances(y, variances)
        return expected

    def initialize_level(self, mismatch: Array) -> None:
        """Set it by how far the rows (n,) of the first tracks differ, in prior deviations."""
        if self._learns and not self._frames and len(mismatch) >= _ENOUGH_ROWS:
            spread = MEDIAN_TO_STD * float(np.median(np.abs(mismatch - np.median(mismatch))))
            self.level = min(max(self.level, spread**2), math.exp(_LIMIT))

    def add(self, count: int) -> None:
        """Append so many landmarks."""
        prior = np.full(count, _PRIOR_NUMBERS)
        self._noise = np.concatenate([self._noise, prior])
        self._observed = np.concatenate([self._observed, prior])
        self._last_error = np.concatenate([self._last_error, np.full(count, np.nan)])

    def remove(self, gone: NDArray[np.bool_]) -> None:
        """Remove the landmarks (n,) that are gone."""
        self._noise, self._observed = self._noise[~gone], self._observed[~gone]
        self._last_error = self._last_error[~gone]

    def update(
        self,
        indices: NDArray[np.int64],
        residual: Array,
        variances: Array,
        information: Array,
        weighted: Array,
    ) -> None:
        """Learn from the inliers of a frame.

        Parameters
        ----------
        indices : ndarray of int64, (n,)
            Indices of the landmarks seen, all different.
        residual : ndarray, (n, 3)
            Innovations r of all three numbers, pixels.
        variances : ndarray, (n, 3)
            Those of :meth:`variances`, square pixels.
        information : ndarray, (n r,)
            Diagonal of ``S^-1``, 1 / square pixels, r numbers for each landmark: those of
            ``components``.
        weighted : ndarray, (n r,)
            ``S^-1 r``, 1 / pixels.
        """
        if not self._learns:
            return
        used = self.components
        shape = len(indices), len(used)
        of_tracks = self._noise, self._observed
        w, D = weighted.reshape(shape), information.reshape(shape)
        excess, from_noise = _learn(*of_tracks, indices, residual, variances, used, w, D)
        self._frames += 1
        frames = min(self._frames + _PRIOR_FRAMES, self._rate.frames(_MEMORY))
        change = min(max(excess / (frames * from_noise), -_LARGEST_CHANGE), _LARGEST_CHANGE)
        self.level = math.exp(min(max(math.log(self.level) + change, -_LIMIT), _LIMIT))
        self._judge_offsets(indices, residual)

    def _scale(self, indices: NDArray[np.int64]) -> Array:
        """Scales (n,) of tracks' own noise."""
        return self._noise[indices] / self._observed[indices]

    def _offset_variances(self, y: Array, variances: Array) -> Array:
        """Variances (n,) of the offsets of disparities at points (n, 3) with such noise (n, 3)."""
        if self.is_stated:
            return np.asarray(variances[:, 0] + variances[:, 1])
        disparity: Array = y[:, 0] - y[:, 1]
        return self._offset_variance + np.square(_RELATIVE_OFFSET * disparity)

    def _judge_offsets(self, indices: NDArray[np.int64], residual: Array) -> None:
        """Learn from the disparities' innovations whether their errors stay."""
        count, staying = _compare_errors(self._last_error, indices, residual)
        if count:
            self._errors = min(self._errors + count, _ERRORS_REMEMBERED)
            self._staying += (staying - count * self._staying) / self._errors


@compiled(
    "UniTuple(float64, 2)(float64[::1], float64[::1], int64[::1], float64[:, ::1],"
    " float64[:, ::1], int64[::1], float64[:, ::1], float64[:, ::1])"
)
def _learn(
    noise: Array,
    observed: Array,
    indices: NDArray[np.int64],
    residual: Array,
    variances: Array,
    used: NDArray[np.int64],
    w: Array,
    D: Array,
) -> tuple[float, float]:
    """Learn the tracks' own noise; return ``r^T S^-1 r - dim r`` and ``tr(S^-1 R)``."""
    excess, all_from_noise = 0.0, 0.0
    for i in range(len(indices)):
        track, squares, from_noise = indices[i], 0.0, 0.0
        for k in range(len(used)):
            R = variances[i, used[k]]
            squares += w[i, k] * w[i, k] * R
            from_noise += D[i, k] * R
            excess += w[i, k] * residual[i, used[k]] - 1.0
        all_from_noise += from_noise
        noise[track] += noise[track] / observed[track] * (squares - from_noise + len(used))
        observed[track] += len(used)
    return excess, all_from_noise


@compiled("UniTuple(int64, 2)(float64[::1], int64[::1], float64[:, ::1])")
def _compare_errors(last: Array, indices: NDArray[np.int64], residual: Array) -> tuple[int, int]:
    """Count the disparities' errors that have one before them, and those that stay near it."""
    count, staying = 0, 0
    for i in range(len(indices)):
        error, before = residual[i, 0] - residual[i, 1], last[indices[i]]
        last[indices[i]] = error
        if math.isfinite(before):
            count += 1
            staying += abs(error - before) < _STAYS * abs(before)
    return count, staying


@compiled("float64(float64, float64, int64)")
def _posterior_scale(own: float, expected: float, r: int) -> float:
    """Scale of an observation of r numbers by what is expected of it and its track's own."""
    return (_PRIOR_NUMBERS * own + expected) / (_PRIOR_NUMBERS + r)


@compiled(
    "float64[:, ::1](float64[:, :, ::1], float64[:, ::1], float64[:, ::1], int64[::1],"
    " float64[::1])"
)
def _with_tails(
    D: Array, w: Array, variances: Array, used: NDArray[np.int64], own: Array
) -> Array:
    """Variances (n, 3) by their track's own scales (n,), and larger of what is far off.

    The covariance ``A + s R_0`` of an innovation given the others is the inverse of its block of
    ``S^-1``, (n, r, r), and ``w_i`` its part of ``S^-1 r``, both worked out with the own scales.
    """
    n, r = w.shape
    larger = variances.copy()
    for i in range(n):
        expected = r * own[i]
        for k in range(r):
            expected += own[i] * variances[i, used[k]] * (w[i, k] * w[i, k] - D[i, k, k])
        scale = max(own[i], _posterior_scale(own[i], expected, r))
        if scale == own[i]:
            continue
        A, _ = small_inverse(D[i])
        residual = A @ w[i]
        for _ in range(1, _ROUNDS):
            S, ratio = A.copy(), scale / own[i]
            for k in range(r):
                S[k, k] += (ratio - 1.0) * variances[i, used[k]]
            inverse, _ = small_inverse(S)
            weighted = inverse @ residual
            expected = r * scale
            for k in range(r):
                R = ratio * variances[i, used[k]]
                expected += scale * R * (weighted[k] * weighted[k] - inverse[k, k])
            scale = max(own[i], _posterior_scale(own[i], expected, r))
        if scale >= _FAR_OFF * own[i]:
            for k in range(3):
                larger[i, k] *= scale / own[i]
    return larger
