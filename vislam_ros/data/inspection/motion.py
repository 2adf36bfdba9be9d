# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What images say against the motion or the extrinsics, as a finding each."""

from collections.abc import Iterable

from vislam_ros.core.verdict.reason import Reason
from vislam_ros.data.finding import Finding

_INVERTED, _AXES = "inverted", "axes"


def judge_motion(reasons: Iterable[Reason]) -> list[Finding]:
    """Name what contradicts: the first reading that fits names it, or no reading does."""
    found = []
    for reason in reasons:
        name, advice = "contradiction", "check extrinsics, twists and their stamps"
        if any(_INVERTED in words for words in reason.readings):
            name, advice = "extrinsics_inverted", "give the inverse"
        elif (
            reason.readings and _AXES in reason.readings[0] and "T_body" not in reason.readings[0]
        ):
            name, advice = (
                "imu_frame",
                "turn twists or extrinsics, so that both have the same axes",
            )
        found.append(
            Finding(name, reason.text, advice, False, {"readings": list(reason.readings)})
        )
    return found
