# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import gc
from contextlib import suppress

import pytest

from vislam_ros.importing import importing


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("was_enabled", [True, False])
def test_the_collector_rests_in_the_block_and_is_as_before_then(
    was_enabled: bool, fails: bool
) -> None:
    try:
        if not was_enabled:
            gc.disable()
        with suppress(ImportError), importing():
            assert not gc.isenabled()
            if fails:
                raise ImportError
        assert gc.isenabled() == was_enabled
    finally:
        gc.enable()
