# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from typing import Any

import numpy as np
import pytest

from vislam_ros.core.compiled import compiled


@compiled("float64(float64[:], float64)")
def quotient_of_sum(values: Any, divisor: Any) -> Any:
    total = 0.0
    for value in values:
        total += value
    return total / divisor


def test_a_division_by_zero_gives_what_numpy_gives() -> None:
    assert quotient_of_sum(np.array([1.0, 2.0]), 0.5) == 6.0
    assert quotient_of_sum(np.array([1.0, 2.0]), 0.0) == math.inf
    assert math.isnan(quotient_of_sum(np.zeros(2), 0.0))


def test_nothing_is_compiled_for_types_that_were_not_told() -> None:
    with pytest.raises(TypeError, match="No matching definition"):
        quotient_of_sum(np.zeros(2, dtype=np.float32), 1.0)


def test_where_machine_code_cannot_be_kept_it_is_made_all_the_same() -> None:
    # A function without a file has no place beside it.
    names: dict[str, Any] = {}
    exec("def twice(x):\n    return 2.0 * x", names)
    twice = compiled("float64(float64)")(names["twice"])
    assert twice(1.5) == 3.0
