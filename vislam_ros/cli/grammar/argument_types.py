# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Types of arguments, each with a message for what is none."""

import argparse
import math
from collections.abc import Callable, Sequence


def number_from(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """Argument type of a finite number in a range, limits included."""

    def number(text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text} is not {_range_text(low, high)}")
        return value

    return number


def whole_from(low: int) -> Callable[[str], int]:
    """Argument type of a whole number from ``low`` on."""

    def whole_number(text: str) -> int:
        value = int(text)
        if value < low:
            raise argparse.ArgumentTypeError(f"{text} is not {_range_text(low, math.inf)}")
        return value

    return whole_number


def _range_text(low: float, high: float) -> str:
    if high < math.inf:
        return f"from {low:g} to {high:g}"
    return "a finite number" if low == -math.inf else f"a finite number from {low:g} on"


def name_or(names: Sequence[str], mark: str, other: str) -> Callable[[str], str]:
    """Argument type of one of some names, or of another kind of text that has a mark in it."""

    def name(text: str) -> str:
        if text not in names and mark not in text:
            raise argparse.ArgumentTypeError(
                f"{text!r} is none of {', '.join(names)}, nor {other}"
            )
        return text

    return name


def assignment(text: str) -> tuple[str, str]:
    """Argument type of a setting's name and its values."""
    name, _, values = text.partition("=")
    if not (name and values):
        raise argparse.ArgumentTypeError(f"{text} is not NODE.NAME=VALUE,...")
    return name, values


def remapping(text: str) -> str:
    """Argument type of a ROS remapping rule."""
    source, _, target = text.partition(":=")
    if not (source and target):
        raise argparse.ArgumentTypeError(f"{text} is not FROM:=TO")
    return text
