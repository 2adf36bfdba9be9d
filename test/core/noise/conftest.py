# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from vislam_ros.core.noise.frame_rate import FrameRate


@pytest.fixture(params=[10, 20, 30], ids="{} Hz".format)
def rate(request: pytest.FixtureRequest) -> FrameRate:
    """Rate of a camera."""
    rate = FrameRate()
    rate.add(1.0 / request.param)
    return rate
