# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings that several filters share; what is one filter's own stands in its file."""

from dataclasses import dataclass

from vislam_ros.core.ranges import LARGEST_PIXEL
from vislam_ros.core.settings import LARGEST_GATE, LARGEST_VARIANCE, SlamSettings, setting


@dataclass(frozen=True)
class GivenMapSettings(SlamSettings):
    """Settings of filters that work on a given map."""

    map_file: str = setting("", "landmarks.npz of an earlier run: the map to localize in")


@dataclass(frozen=True)
class ObservationSettings(SlamSettings):
    """Settings of filters that observations correct."""

    pixel_variance: tuple[float, ...] = setting(
        (1.0, 1.0, 1.0, 1.0),
        "Variances of u_left, v_left, u_right, v_right [px^2]; four equal ones make the filter "
        "use three exact rows in place of four",
        minimum=1e-12,
        maximum=LARGEST_VARIANCE,
        live=True,
    )
    chi2_gate: float = setting(
        16.27,
        "An observation whose squared Mahalanobis distance (3 degrees of freedom) is larger is "
        "rejected; 0 turns the gate off",
        minimum=0.0,
        maximum=LARGEST_GATE,
        live=True,
    )
    pixel_gate: float = setting(
        0.0,
        "An observation farther than this from its prediction is rejected [px]; 0 turns the "
        "gate off",
        minimum=0.0,
        maximum=LARGEST_PIXEL,
        live=True,
    )


@dataclass(frozen=True)
class WorldLandmarkSettings(ObservationSettings):
    """Settings of filters that estimate landmarks in the world, in metres."""

    landmark_initialization: str = setting(
        "correlated",
        "Covariance of a new landmark: correlated (J P J^T + R, with its cross-covariance) or "
        "the report's independent (landmark_prior_variance times the identity, none)",
        choices=("correlated", "independent"),
    )
    landmark_prior_variance: float = setting(
        0.5,
        "Variance of each axis of a new landmark [m^2], with landmark_initialization: independent",
        minimum=0.0,
        maximum=LARGEST_VARIANCE,
        live=True,
    )
    min_disparity: float = setting(
        1.0,
        "Observations with a smaller disparity are not used, for their landmarks' positions in "
        "metres are not known [px]",
        minimum=1e-3,
        maximum=LARGEST_PIXEL,
        live=True,
    )
