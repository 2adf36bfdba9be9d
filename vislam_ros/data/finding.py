# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Something that is wrong with data: what it is, what is done about it, and its figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: What can be wrong, each by its name and in a few words.
NAMES: Mapping[str, str] = {
    "stamps": "times that do not increase evenly",
    "frozen_steps": "frames whose tracks repeat their last pixels while the body moves",
    "left_right_swapped": "left and right exchanged",
    "right_camera": "a right camera that is not as the calibration says",
    "pixel_scale": "pixels of images of another size than the intrinsics'",
    "disparities": "disparities that are negative beyond noise",
    "moving_tracks": "tracks that do not go with the scene",
    "imu_frame": "twists and extrinsics in different axes",
    "twist_index": "twists that hold from their stamp on",
    "twist_origin": "twists of another point than the body that the extrinsics describe",
    "extrinsics_inverted": "extrinsics that map the other way",
    "gyro_bias": "a constant error of the gyroscope",
    "contradiction": "images and motion that do not fit in any way that was tried",
}


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with data.

    Attributes
    ----------
    name : str
        One of :data:`NAMES`.
    words : str
        What was found, with its figure, in a short line.
    advice : str
        What reading or the estimate does about it, or what the user has to do.
    is_repaired : bool
        Whether whoever reads or solves the data has nothing to do.
    numbers : mapping of str to number, str or list
        The figures, for JSON.
    """

    name: str
    words: str
    advice: str
    is_repaired: bool
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.name not in NAMES:
            raise ValueError(f"{self.name!r} is no name of a finding")

    @property
    def note(self) -> str:
        """In a short line, as the commands that read data say it."""
        return f"{self.name}: {self.words}: {self.advice}"

    def as_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "name": self.name,
            "words": self.words,
            "advice": self.advice,
            "is_repaired": self.is_repaired,
            "numbers": dict(self.numbers),
        }
