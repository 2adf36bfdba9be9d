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


# Sums in any order, and products and sums in one: what lets a processor add eight numbers at once.
_REORDERED = {"reassoc", "contract", "nsz"}


def compiled(*signatures: str, reordered: bool = False) -> Callable[[Function], Function]:
    """Compile a function for arguments of these types; a division by zero gives inf or NaN.

    Parameters
    ----------
    *signatures : str
        As numba writes them: ``"float64(float64[:, ::1], int64)"`` takes a C-ordered matrix and a
        number and returns a number.
    reordered : bool
        Whether sums may be taken in the order that is fastest: for loops over pixels, whose last
        bits mean nothing. They are the same in every run on a machine.
    """

    def compile_now(function: Function) -> Function:
        types = list(signatures)
        fast: bool | set[str] = _REORDERED if reordered else False
        try:
            return cast(
                Function,
                numba.njit(types, cache=True, error_model="numpy", fastmath=fast)(function),
            )
        except (OSError, RuntimeError):
            # No place to keep the machine code in: it lasts as long as the process.
            return cast(Function, numba.njit(types, error_model="numpy", fastmath=fast)(function))

    return compile_now
