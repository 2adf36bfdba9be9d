# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From image points to the map: world positions of landmarks that the robocentric filter holds.

Marginalizing a landmark costs the filter's step a few copies; its position in the world is worked
out when somebody asks for the map, for all that are waiting at once. Triangulation and the way to
the world are the report's eq. 4-5.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.filters.robocentric_model import LENS, POSE, POSE_AND_LENS, SIZE
from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.lens import radial_shift
from vislam_ros.core.landmarks import LandmarkStore
from vislam_ros.core.motion import symmetrized
from vislam_ros.core.operations.bias_belief import BiasBelief
from vislam_ros.core.operations.error_state import ErrorState
from vislam_ros.core.operations.marginalization import WorldPositions
from vislam_ros.core.tracking.tracked_frame import Keys

Array = NDArray[np.float64]

# A landmark has a position in metres where its disparity is positive beyond doubt; nearer to zero
# than this many standard deviations no Gaussian in metres describes it.
_SIGNIFICANT_DISPARITY = 2.0


@dataclass(frozen=True)
class ImagePoints:
    """Landmarks as image points, with their errors and those of the state they lie in.

    Attributes
    ----------
    y : ndarray, (m, 3)
        ``(u_left, u_right, v)`` in the camera's frame, pixels, free of distortion.
    own : ndarray, (m, 3, 3)
        Covariances of the errors at a given distortion: the error of y is ``delta_y +
        D(y) delta_kappa`` (see lens).
    cross : ndarray, (m, 3, 7)
        Covariances with the errors of the pose and of the lens.
    pose_and_lens : ndarray, (7, 7) or (m, 7, 7)
        Covariance of these.
    T_world_body : ndarray, (4, 4) or (m, 4, 4)
    """

    y: Array
    own: Array
    cross: Array
    pose_and_lens: Array
    T_world_body: Array

    def of(self, chosen: NDArray[np.bool_]) -> "ImagePoints":
        """Some (m,) of these landmarks, of one state."""
        if np.all(chosen):
            return self
        return replace(self, y=self.y[chosen], own=self.own[chosen], cross=self.cross[chosen])


class Positions(NamedTuple):
    """World positions of landmarks, and how they depend on the error state.

    Attributes
    ----------
    means : ndarray, (m, 3)
        Metres.
    covariances : ndarray, (m, 3, 3)
    J_vehicle : ndarray, (m, 3, 7)
        Derivative by the errors of pose and lens.
    J_landmark : ndarray, (m, 3, 3)
        Derivative by the image point.
    """

    means: Array
    covariances: Array
    J_vehicle: Array
    J_landmark: Array


@compiled("boolean[::1](float64[:, :], float64[:, :, :])")
def has_position(y: Array, own: Array) -> NDArray[np.bool_]:
    """Tell which image points (m, 3) with covariances (m, 3, 3) are at a certain distance."""
    certain = np.empty(len(y), dtype=np.bool_)
    for i in range(len(y)):
        variance = max(own[i, 0, 0] + own[i, 1, 1] - 2 * own[i, 0, 1], 0.0)
        certain[i] = y[i, 0] - y[i, 1] > _SIGNIFICANT_DISPARITY * math.sqrt(variance)
    return certain


def world_positions(camera: StereoCamera, points: ImagePoints) -> Positions:
    """Positions of landmarks that have one."""
    means, J_s, J_y = _placed(camera, points)
    mixed = J_y @ points.cross @ np.swapaxes(J_s, -1, -2)
    covariances = (
        J_s @ points.pose_and_lens @ np.swapaxes(J_s, -1, -2)
        + mixed
        + np.swapaxes(mixed, -1, -2)
        + J_y @ points.own @ np.swapaxes(J_y, -1, -2)
    )
    return Positions(means, symmetrized(covariances), J_s, J_y)


def _placed(camera: StereoCamera, points: ImagePoints) -> tuple[Array, Array, Array]:
    """Means and derivatives of :class:`Positions`, without the covariances."""
    y = points.y
    T_body_camera, T = camera.T_body_camera, points.T_world_body
    points_body = camera.triangulate(y) @ T_body_camera[:3, :3].T + T_body_camera[:3, 3]
    R = T[..., :3, :3]
    means = (R @ points_body[..., None])[..., 0] + T[..., :3, 3]
    J_y = (R @ T_body_camera[:3, :3]) @ camera.triangulate_jacobian(y)
    J_s = np.zeros(points.cross.shape)
    J_s[:, :, :3] = R
    J_s[:, :, 3:6] = -R @ se3.hat(points_body)
    J_s[:, :, -1] = (J_y @ radial_shift(camera, y)[..., None])[..., 0]
    return means, J_s, J_y


def image_points_in(
    state: ErrorState, y: Array, slots: NDArray[np.int64], T_world_body: Array
) -> ImagePoints:
    """Landmarks in some slots (m,) of a state, at image points (m, 3)."""
    P = state.covariance
    return ImagePoints(
        y=y,
        own=state.landmark_covariances()[slots],
        cross=P[state.rows_of(slots)[:, :, None], POSE_AND_LENS],
        pose_and_lens=P[POSE_AND_LENS[:, None], POSE_AND_LENS],
        T_world_body=T_world_body,
    )


def points_of_both(
    camera: StereoCamera, points: ImagePoints, rows: NDArray[np.int64], belief: BiasBelief
) -> ImagePoints:
    """Landmarks in rows (m, 3) of one state, as the beliefs in a bias and in none have them."""
    if not belief.changes:
        return points
    delta, spread = belief.delta, belief.spread
    of_state = belief.gain[POSE_AND_LENS]
    own, cross = _with_spread(points.own, points.cross, belief.gain, rows, spread, of_state)
    return ImagePoints(
        y=points.y + delta[rows] + delta[LENS] * radial_shift(camera, points.y),
        own=own,
        cross=cross,
        pose_and_lens=points.pose_and_lens + of_state @ spread @ of_state.T,
        T_world_body=points.T_world_body @ se3.exp(delta[POSE]),
    )


@compiled(
    "UniTuple(float64[:, :, ::1], 2)(float64[:, :, ::1], float64[:, :, ::1], float64[:, ::1],"
    " int64[:, ::1], float64[:, ::1], float64[:, ::1])"
)
def _with_spread(
    own: Array,
    cross: Array,
    gain: Array,
    rows: NDArray[np.int64],
    spread: Array,
    of_state: Array,
) -> tuple[Array, Array]:
    """Add what two beliefs are apart to points' own covariances, and to those with the state."""
    own, cross = own.copy(), cross.copy()
    for i in range(len(rows)):
        for r in range(3):
            for k in range(3):
                apart = 0.0
                for m in range(3):
                    apart += gain[rows[i, r], m] * spread[m, k]
                for c in range(3):
                    own[i, r, c] += apart * gain[rows[i, c], k]
                for c in range(len(of_state)):
                    cross[i, r, c] += apart * of_state[c, k]
    return own, cross


def positions_of_all(
    camera: StereoCamera, points: ImagePoints, mapped: NDArray[np.bool_]
) -> WorldPositions:
    """Positions of landmarks (m,), and zeros for those that have none, by the whole state."""
    known_means, by_vehicle, by_landmark = _placed(camera, points.of(mapped))
    means, J_landmark = np.zeros((len(mapped), 3)), np.zeros((len(mapped), 3, 3))
    J_vehicle = np.zeros((len(mapped), 3, SIZE))
    means[mapped], J_landmark[mapped] = known_means, by_landmark
    J_vehicle[np.ix_(mapped, np.arange(3), POSE_AND_LENS)] = by_vehicle
    return WorldPositions(means, J_vehicle, J_landmark)


class ImagePointMap:
    """Landmarks that were marginalized as image points.

    Parameters
    ----------
    camera : StereoCamera
    """

    def __init__(self, camera: StereoCamera):
        self._camera = camera
        self._store = LandmarkStore()
        self._waiting: list[tuple[Keys, ImagePoints]] = []
        self._waiting_count = 0

    @property
    def count(self) -> int:
        """How many they are."""
        return self._store.count + self._waiting_count

    def add(self, keys: Keys, points: ImagePoints) -> None:
        """Add landmarks (m,) that have a position; of one state, one pose and one lens."""
        if len(keys):
            self._waiting.append((keys, points))
            self._waiting_count += len(keys)

    def all(self) -> tuple[Keys, Array, Array]:
        """Keys (M,), world positions (M, 3) and covariances (M, 3, 3), in the order they came."""
        if self._waiting:
            keys = np.concatenate([keys for keys, _ in self._waiting])
            means, covariances, _, _ = world_positions(self._camera, self._joined())
            self._store.add(keys, means, covariances)
            self._waiting, self._waiting_count = [], 0
        return self._store.all()

    def _joined(self) -> ImagePoints:
        batches = [points for _, points in self._waiting]
        counts = [len(points.y) for points in batches]
        return ImagePoints(
            y=np.concatenate([points.y for points in batches]),
            own=np.concatenate([points.own for points in batches]),
            cross=np.concatenate([points.cross for points in batches]),
            pose_and_lens=np.repeat([points.pose_and_lens for points in batches], counts, axis=0),
            T_world_body=np.repeat([points.T_world_body for points in batches], counts, axis=0),
        )
