# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Compilation of loops over landmarks, where numpy's calls would take longer than the arithmetic.

A compiled function takes the types of its signatures alone, so it is compiled when its module is
imported and never in the middle of a drive. The machine code is kept on disk, beside the module
or in the user's cache, until the module changes. What a compiled function calls is part of it, so
it calls compiled functions of its own module only.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(*signatures: str) -> Callable[[Function], Function]:
    """Compile a function for arguments of these types; a division by zero gives inf or NaN.

    Parameters
    ----------
    *signatures : str
        As numba writes them: ``"float64(float64[:, ::1], int64)"`` takes a C-ordered matrix and a
        number and returns a number.

    Sums keep their order. Otherwise the last bits would depend on whether a function that is
    called was compiled in the same process or came from the cache: live and offline would differ.
    """

    def compile_now(function: Function) -> Function:
        types = list(signatures)
        try:
            return cast(Function, numba.njit(types, cache=True, error_model="numpy")(function))
        except (OSError, RuntimeError):
            # No place to keep the machine code in: it lasts as long as the process.
            return cast(Function, numba.njit(types, error_model="numpy")(function))

    return compile_now
