# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stereo images to measure the front end on: recorded ones where they are, and simulated ones."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.data.loading import load_drive

Grey = NDArray[np.uint8]
Array = NDArray[np.float64]

# A wall that the simulated camera drives at, and its step [m].
_DISTANCE, _STEP = 6.0, 0.1


@dataclass(frozen=True)
class ImageSet:
    """Rectified pairs of a camera.

    Attributes
    ----------
    name : str
    camera : StereoCamera
    pairs : list of tuple of ndarray of uint8, (H, W)
    rotations : list of ndarray, (3, 3)
        Of the left camera since the pair before, in its axes; the first counts for nothing.
    features : int
        How many points to follow.
    """

    name: str
    camera: StereoCamera
    pairs: list[tuple[Grey, Grey]]
    rotations: list[Array]
    features: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        height, width = self.pairs[0][0].shape
        return width, height


def image_sets(shared_data: Path, frames: int) -> list[ImageSet]:
    """Image sets of so many frames: the simulated wall, and the recorded street if it is there."""
    sets = [wall(frames)]
    street = shared_data.parent / "images" / "kitti_0020"
    if street.is_dir() and (shared_data / "0020.npz").is_file():
        sets.append(_street(street, shared_data / "0020.npz", frames))
    return sets


def wall(frames: int, *, size: tuple[int, int] = (752, 480), features: int = 150) -> ImageSet:
    """A camera that drives straight at a wall of random texture; its noise is 2 grey values."""
    width, height = size
    rng = np.random.default_rng(0)
    focal, baseline = 0.6 * width, 0.11
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    texture = np.zeros((height, width), np.float32)
    for cells in (8, 30, 100):
        grain = rng.uniform(-30, 30, (cells, cells)).astype(np.float32)
        texture += cv2.resize(grain, size, interpolation=cv2.INTER_CUBIC)
    texture += 120

    def seen(position: float, aside: float) -> Grey:
        # From a pixel to the texture, which is the view from the start.
        scale = (_DISTANCE - position) / _DISTANCE
        shift = focal * aside / _DISTANCE
        middle = np.array([width / 2, height / 2])
        M = np.column_stack([scale * np.eye(2), middle * (1 - scale) + [shift, 0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        view = cv2.warpAffine(texture, M, size, flags=flags, borderMode=cv2.BORDER_REFLECT)
        return np.clip(np.rint(view + rng.normal(0, 2, view.shape)), 0, 255).astype(np.uint8)

    pairs = [(seen(k * _STEP, 0.0), seen(k * _STEP, baseline)) for k in range(frames)]
    camera = StereoCamera.from_matrices(K, baseline, np.eye(4))
    return ImageSet("a wall, simulated", camera, pairs, [np.eye(3)] * frames, features)


def _street(folder: Path, data: Path, frames: int) -> ImageSet:
    drive = load_drive(data)
    names = sorted(folder.glob("image_l/*.png"))[:frames]
    pairs = [
        (
            np.asarray(cv2.imread(str(name), cv2.IMREAD_GRAYSCALE), np.uint8),
            np.asarray(
                cv2.imread(str(folder / "image_r" / name.name), cv2.IMREAD_GRAYSCALE), np.uint8
            ),
        )
        for name in names
    ]
    steps = np.diff(drive.feature_stamps[: len(names)], prepend=drive.feature_stamps[0]) * 1e-9
    turns = steps[:, None] * drive.twists[: len(names), 3:]
    R_camera_body = drive.camera.T_camera_body[:3, :3]
    rotations = [R_camera_body @ se3.exp_rotation(-turn) @ R_camera_body.T for turn in turns]
    return ImageSet("a street, recorded", drive.camera, pairs, rotations, 200)
