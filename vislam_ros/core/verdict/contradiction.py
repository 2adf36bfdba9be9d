# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether images and twists contradict each other, and what else would fit.

In each step the images tell the motion m of the camera, and under a reading B (see readings) the
twist u tells ``tau B (u - b)``, with slow errors b that filters estimate. What differs is ::

    e = m - tau B (u - b)

and ``e^T A e`` says how far that moves the images' points, in square pixels. Of a pair of steps
whose noise has nothing in common (see evidence), ``q = e_1^T A e_2`` has the mean of what is wrong
alone: its root is the *mismatch*, pixels a step, however noisy the twist is.

One reading is held against another by the likelihood of heavy-tailed errors, ``sum log(1 + e^T A e
/ s^2)`` with the median s^2 of the better one. Under the worse one a ratio of e^x comes by chance
once in e^x times. A scale is the same regression, ``m = tau B (S u - b)``, with the other step of
the pair as its instrument, so that the noise of the twist does not make it smaller; its standard
error is that of its own terms.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.verdict.evidence import REACH, StepPair
from vislam_ros.core.verdict.readings import as_given, other_readings
from vislam_ros.core.verdict.reason import Reason, Word

Array = NDArray[np.float64]

# With fewer pairs nothing is said.
_FEWEST_PAIRS = 8
# Logarithm of how many times likelier another reading has to be.
_EVIDENCE = 14.0
# Standard errors by which a mismatch or the logarithm of a scale is beyond chance.
_BEYOND_CHANCE = 4.0
# Shares of the whole motion: a mismatch that is doubtful, and one that is a contradiction. Another
# reading must leave less than half of the mismatch.
_DOUBTFUL, _CONTRADICTION, _LEFT = 0.25, 0.5, 0.5
# A scale that differs by less is that of a calibration, and one that moves the images by less than
# this share of their motion does not matter.
_SCALE, _MATTERS = 1.15, 0.05
# Twists that are this many steps late or early are those of other steps.
_STEPS_OFF = 2
# Slow errors of a twist that filters estimate, and their prior: of the velocity's y and z [m/s]
# and of the gyroscope [rad/s].
_SLOW = np.eye(6)[:, 1:]
_SLOW_STD = np.array([0.3, 0.3, 0.02, 0.02, 0.02])
_SMALLEST_SQUARE = 1e-6
_UNITS = {3.6: "km/h", 57.3: "degrees", 1000.0: "millimetres"}


class _Steps(NamedTuple):
    """Pairs as arrays: n pairs of 2 steps."""

    tau: Array  # (n, 2, 1)
    motion: Array  # (n, 2, 6)
    metric: Array  # (n, 6, 6)
    twists: Array  # (n, 2, 2 REACH + 1, 6)

    @classmethod
    def of(cls, pairs: Sequence[StepPair]) -> "_Steps":
        return cls(
            np.array([pair.tau for pair in pairs]).reshape(-1, 2, 1),
            np.array([pair.motion for pair in pairs]).reshape(-1, 2, 6),
            np.array([pair.metric for pair in pairs]).reshape(-1, 6, 6),
            np.array([pair.twists for pair in pairs]).reshape(-1, 2, 2 * REACH + 1, 6),
        )

    def where(self, chosen: NDArray[np.bool_]) -> "_Steps":
        return _Steps(*(array[chosen] for array in self))


class _Fit(NamedTuple):
    """How a reading fits."""

    products: Array  # (n,) q of each pair, square pixels
    squares: Array  # (n, 2) e^T A e, square pixels

    @property
    def mismatch(self) -> float:
        """Root of the mean of q, pixels; 0 where noise has made the mean negative."""
        return _root(self.products)

    @property
    def is_beyond_chance(self) -> bool:
        """Whether q is positive more often, and by more, than noise would be.

        Sums over their own scatter, of terms that no single pair rules.
        """
        size = np.abs(self.products)
        terms = self.products / (size + np.median(size) + _SMALLEST_SQUARE)
        return float(np.sum(terms)) > _BEYOND_CHANCE * math.sqrt(float(np.sum(terms**2)))

    def evidence_against(self, other: "_Fit") -> float:
        """Logarithm of how many times likelier this one is."""
        middle = max(float(np.median(self.squares)), _SMALLEST_SQUARE)
        return float(np.sum(np.log1p(other.squares / middle) - np.log1p(self.squares / middle)))


class _Scales(NamedTuple):
    """How many times as large as in the images velocity and angular velocity of the twists are."""

    factors: Array  # (2,)
    errors: Array  # (2,), standard errors of their logarithms
    sizes: Array  # (2,), how far the images move by either, pixels a step


def contradictions(pairs: Sequence[StepPair], camera: StereoCamera) -> Iterator[Reason]:
    """Yield what the images of a drive say against its twists or its calibration."""
    steps = _Steps.of(pairs)
    steps = steps.where(_known(steps.twists[:, :, REACH]))
    if len(steps.tau) < _FEWEST_PAIRS:
        return
    given, twists = as_given(camera), steps.twists[:, :, REACH]
    fit = _fit(steps, twists, given)
    flow = _root(_products(steps, steps.motion))
    scales = _scales(steps, twists, given)
    scaled = _fit(steps, twists @ np.diag(np.repeat(1.0 / scales.factors, 3)), given)
    best, late = _EVIDENCE, 0
    if np.all(scales.factors > 0):
        best = max(best, scaled.evidence_against(fit))
    for shift, evidence in _shifted(steps, given, fit):
        if evidence > best:
            best, late = evidence, shift
    readings = _better_readings(steps, camera, fit, best)
    if readings:
        words = " or ".join(f"{words} would fit ({left:.1f} px)" for words, left in readings)
        yield Reason(
            Word.CONTRADICTION,
            f"images and twists contradict each other by {fit.mismatch:.1f} px in a step that "
            f"moves the image by {flow:.1f} px: {words}",
            tuple(words for words, _ in readings),
        )
        return
    reasons = [] if abs(late) < _STEPS_OFF else [_time_reason(late)]
    if scaled.mismatch <= _DOUBTFUL * flow:
        # Not by its likelihood: a smaller scale also makes the noise of the twists smaller.
        explains = fit.is_beyond_chance and scaled.mismatch < _LEFT * fit.mismatch
        is_certain = explains and fit.mismatch > _DOUBTFUL * flow
        reasons += _scale_reasons(scales, flow, is_certain=is_certain)
    if not reasons and fit.mismatch > _DOUBTFUL * flow and fit.is_beyond_chance:
        reasons.append(
            Reason(
                Word.CONTRADICTION if fit.mismatch > _CONTRADICTION * flow else Word.DOUBTFUL,
                f"images and twists contradict each other by {fit.mismatch:.1f} px in a step that "
                f"moves the image by {flow:.1f} px, and no other reading that was tried fits: "
                "check extrinsics and twists",
            )
        )
    yield from reasons


def _better_readings(
    steps: _Steps, camera: StereoCamera, given: _Fit, evidence: float
) -> list[tuple[str, float]]:
    """Find the simplest readings that fit so much better that the one given cannot be right.

    Parameters
    ----------
    steps : _Steps
    camera : StereoCamera
    given : _Fit
    evidence : float
        What they must have more of, against the one given.

    Returns
    -------
    list of (str, float)
        Words and mismatches of those that cannot be told apart, the likeliest first.
    """
    found: list[tuple[float, str, float]] = []
    for changes, readings in enumerate(other_readings(camera), start=1):
        for reading in readings:
            fit = _fit(steps, steps.twists[:, :, REACH], reading.camera_from_twist)
            gained = fit.evidence_against(given)
            if gained > evidence and fit.mismatch < _LEFT * given.mismatch:
                found.append((gained, reading.words, fit.mismatch))
        # More changes need as much more evidence.
        evidence = changes * _EVIDENCE + max([evidence, *(gained for gained, *_ in found)])
    found.sort(reverse=True)
    return [(words, left) for gained, words, left in found if gained > found[0][0] - _EVIDENCE]


def _scale_reasons(scales: _Scales, flow: float, *, is_certain: bool) -> Iterator[Reason]:
    # What is not measured moves nothing, and its factor is anything.
    shares = np.abs(np.where(scales.sizes > 0.0, scales.factors, 1.0) - 1.0) * scales.sizes
    checks = ("its unit, the baseline and the focal length", "its unit and the focal length")
    for what, check, factor, error, share in zip(
        ("velocity", "angular velocity"),
        checks,
        scales.factors.tolist(),
        scales.errors.tolist(),
        shares.tolist(),
        strict=True,
    ):
        if not (factor > 0 and math.isfinite(error)):
            continue
        off = abs(math.log(factor))
        # What explains the mismatch is the one that moves the images more.
        certain = off > _BEYOND_CHANCE * error or (is_certain and share == np.max(shares))
        if certain and share > _MATTERS * flow and off > math.log(_SCALE):
            yield Reason(
                Word.CONTRADICTION,
                f"the {what} of the twists is {factor:.3g} times that of the images"
                f"{_unit(factor)}: check {check}",
            )


def _unit(factor: float) -> str:
    for size, name in _UNITS.items():
        if abs(math.log(factor / size)) < math.log(_SCALE):
            return f", as if in {name}"
    return ""


def _time_reason(late: int) -> Reason:
    return Reason(
        Word.DOUBTFUL,
        f"the twists seem to be {abs(late)} steps {'late' if late > 0 else 'early'} for the "
        "images: check the time stamps of both",
    )


def _shifted(steps: _Steps, given: Array, fit: _Fit) -> Iterator[tuple[int, float]]:
    """Yield by how many steps the twists may be late, and the evidence for it."""
    for late in range(-REACH, REACH + 1):
        twists = steps.twists[:, :, REACH + late]
        known = _known(twists)
        if late and np.count_nonzero(known) >= _FEWEST_PAIRS:
            shifted = _fit(steps.where(known), twists[known], given)
            yield late, shifted.evidence_against(_Fit(fit.products[known], fit.squares[known]))


def _fit(steps: _Steps, twists: Array, camera_from_twist: Array) -> _Fit:
    """Fit the slow errors of a reading, and tell what is left."""
    e = steps.motion - steps.tau * (twists @ camera_from_twist.T)
    squares = _squares(steps, e)
    middle = max(float(np.median(squares)), _SMALLEST_SQUARE)
    weighted = steps.tau / (1.0 + squares / middle)[..., None]
    G = camera_from_twist @ _SLOW
    normal = np.tensordot(np.sum(weighted * steps.tau, axis=1)[:, 0], steps.metric, axes=1)
    right = np.einsum("nij,nj->i", steps.metric, np.sum(weighted * e, axis=1))
    b = np.linalg.solve(G.T @ normal @ G + middle * np.diag(_SLOW_STD**-2.0), G.T @ right)
    e = e - steps.tau * (G @ b)
    return _Fit(_products(steps, e), _squares(steps, e))


def _known(twists: Array) -> NDArray[np.bool_]:
    """Tell of which pairs both twists (n, 2, 6) are known."""
    return np.asarray(np.isfinite(twists).all(axis=(1, 2)))


def _products(steps: _Steps, e: Array) -> Array:
    return np.einsum("ni,nij,nj->n", e[:, 0], steps.metric, e[:, 1])


def _squares(steps: _Steps, e: Array) -> Array:
    return np.sum((e @ steps.metric) * e, axis=2)


def _scales(steps: _Steps, twists: Array, camera_from_twist: Array) -> _Scales:
    """Regress the images' motion on the twists', each step of a pair the other's instrument."""
    X = np.empty((*steps.motion.shape, 2 + _SLOW.shape[1]))
    for k in range(2):
        part = np.zeros(6)
        part[3 * k : 3 * k + 3] = 1.0
        X[..., k] = steps.tau * ((part * twists) @ camera_from_twist.T)
    X[..., 2:] = steps.tau[..., None] * (camera_from_twist @ _SLOW)
    AX = steps.metric[:, None] @ X
    normals = np.swapaxes(X[:, 0], 1, 2) @ AX[:, 1]
    normals = 0.5 * (normals + np.swapaxes(normals, 1, 2))
    rights = 0.5 * (
        np.einsum("nia,ni->na", AX[:, 0], steps.motion[:, 1])
        + np.einsum("nia,ni->na", AX[:, 1], steps.motion[:, 0])
    )
    middle = max(float(np.median(_squares(steps, steps.motion))), _SMALLEST_SQUARE)
    prior = np.zeros((len(X[0, 0, 0]),) * 2)
    prior[2:, 2:] = middle * np.diag(_SLOW_STD**-2.0)
    inverse = np.linalg.pinv(np.sum(normals, axis=0) + prior)
    s = inverse @ np.sum(rights, axis=0)
    scatter = rights - normals @ s
    # As many terms as there are unknowns have no scatter left.
    n, unknowns = rights.shape
    spare = n / (n - unknowns) if n > unknowns else np.inf
    covariance = spare * (inverse @ (scatter.T @ scatter) @ inverse)
    sizes = np.array([_root(s[k] ** 2 * normals[:, k, k]) for k in range(2)])
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.sqrt(np.diag(covariance)[:2]) / np.abs(s[:2])
        return _Scales(1.0 / s[:2], errors, sizes)


def _root(products: Array) -> float:
    """Root of a mean; 0 where noise has made it negative."""
    return math.sqrt(max(float(np.mean(products)), 0.0))
