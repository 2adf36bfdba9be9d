# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The course's images: ``datasetXX_imgs.npy``, a dict of two lists, beside ``datasetXX.npy``.

The lists ``cam_imgs_L`` and ``cam_imgs_R`` hold a grey image (H, W) for each time stamp of the
dataset, which has the calibration and the motion. Gigabytes of images stay in their file.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import Intrinsics, PixelRectification
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.data.files.inputs import open_input
from vislam_ros.data.images.folders.array_places import (
    FEWEST_BYTES,
    LocatedArray,
    Place,
    locate_arrays,
)
from vislam_ros.data.images.given_motion import GivenMotion, with_motion
from vislam_ros.data.images.image_file import LARGEST_IMAGE
from vislam_ros.data.images.stereo_images import RawImage, StereoImages
from vislam_ros.errors import VislamError

_ENDING = "_imgs"
_SIDES = ("cam_imgs_L", "cam_imgs_R")
_CHANNELS = {2: "mono8", 3: "bgr8"}


def matches(path: Path) -> bool:
    """Whether a path looks like such a file, by its name."""
    return path.is_file() and path.suffix == ".npy" and path.stem.endswith(_ENDING)


def dataset_of(path: Path) -> Path | None:
    """Dataset beside a file of images; None where there is none."""
    stem = path.stem.removesuffix(_ENDING)
    beside = (path.with_name(f"{stem}{suffix}") for suffix in (".npy", ".npz"))
    return next((each for each in beside if each.is_file()), None)


def images_of(dataset: Path) -> Path | None:
    """File of images beside a dataset; None where there is none."""
    beside = dataset.with_name(f"{dataset.stem}{_ENDING}.npy")
    return beside if dataset.suffix in (".npy", ".npz") and matches(beside) else None


def read(path: Path, given: GivenMotion | None) -> StereoImages:
    """Open such a file.

    Parameters
    ----------
    path : Path
    given : GivenMotion or None
        Of the dataset: it has the calibration.

    Raises
    ------
    VislamError
        Where the file is none, is damaged, or nothing tells its calibration.
    """
    if given is None or given.camera is None:
        name = path.name.replace(_ENDING, "")
        raise VislamError(
            f"{path}: holds images alone: put their dataset {name} beside them, or give it with "
            "--motion"
        )
    with open_input(path, "these images") as file:
        content = locate_arrays(_past_header(file, path), str(path))
    left, right = (_Side(path, name, content) for name in _SIDES)
    count = min(len(left), len(right))
    notes = []
    if len(left) != len(right):
        notes.append(f"Left out {abs(len(left) - len(right))} images without a partner.")
    images = StereoImages(
        name=path.stem.removesuffix(_ENDING),
        rig=_rig(given.camera, given.rectification, left.size, right.size),
        stamps=np.arange(count, dtype=np.int64),
        places=range(count),
        reader=_Reader(path, left, right),
        timed=False,
        notes=tuple(notes),
    )
    return with_motion(images, given)


def _rig(
    camera: StereoCamera,
    rectification: PixelRectification | None,
    left_size: tuple[int, int],
    right_size: tuple[int, int],
) -> StereoRig:
    """Cameras as they were before pixels became those of the rectified camera."""
    turns = (None, None) if rectification is None else (rectification.left, rectification.right)
    rectified = Intrinsics(camera.fx, camera.fy, camera.cx, camera.cy)
    sides: list[RawCamera] = []
    T_rectified_raw: list[NDArray[np.float64]] = []
    for turn, size in zip(turns, (left_size, right_size), strict=True):
        fx, fy, cx, cy = rectified if turn is None else turn.before
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        sides.append(RawCamera(size, K, "", np.zeros(0)))
        T = np.eye(4)
        if turn is not None and turn.R_after_before is not None:
            T[:3, :3] = np.reshape(turn.R_after_before, (3, 3))
        T_rectified_raw.append(T)
    T_left, T_right = T_rectified_raw
    T_between = np.eye(4)
    T_between[0, 3] = camera.baseline
    left, right = sides
    T_left_right = se3.inverse(T_left) @ T_between @ T_right
    return StereoRig(left, right, T_left_right, camera.T_body_camera @ T_left)


def _past_header(file: Any, path: Path) -> Any:
    """File of an object array of shape (), at its pickle's first byte."""
    try:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, _, dtype = np.lib.format.read_array_header_1_0(file)
            if shape == () and dtype.hasobject:
                return file
    except ValueError:
        pass
    raise VislamError(
        f"{path}: is no file of images: numpy.save a dict of {_SIDES[0]} and {_SIDES[1]}"
    )


class _Side:
    """Where the images of a camera lie, all of one shape."""

    def __init__(self, path: Path, name: str, content: Any):
        images = content.get(name) if isinstance(content, dict) else None
        if isinstance(images, LocatedArray):
            images = _unstacked(images)
        if not isinstance(images, list) or not images:
            raise VislamError(
                f"{path}: {name} holds no images: give a list of (H, W) uint8 arrays"
            )
        first = images[0]
        for k, image in enumerate(images):
            if not _is_image(image) or image.shape != first.shape:
                raise VislamError(f"{path}: {name}[{k}] is no image (H, W) of uint8 as the others")
        self.shape: tuple[int, ...] = first.shape
        self.size = (self.shape[1], self.shape[0])
        self._images: list[LocatedArray] = images

    def __len__(self) -> int:
        return len(self._images)

    def read(self, file: Any, path: Path, place: int) -> RawImage:
        """Read an image of an open file."""
        image = self._images[place]
        file.seek(image.place.offset)
        data = bytearray(image.place.length)
        if file.readinto(data) < len(data):
            raise VislamError(f"{path}: was cut off while it was being read")
        flat = np.frombuffer(data, np.uint8)
        pixels = (
            flat.reshape(self.shape[::-1]).T if image.fortran_order else flat.reshape(self.shape)
        )
        return RawImage(np.ascontiguousarray(pixels), _CHANNELS[len(self.shape)])


def _is_image(image: Any) -> bool:
    return (
        isinstance(image, LocatedArray)
        and image.dtype == np.uint8
        and (len(image.shape) == 2 or (len(image.shape) == 3 and image.shape[2] == 3))
        and 0 < image.shape[0] * image.shape[1] <= LARGEST_IMAGE
    )


def _unstacked(stack: LocatedArray) -> list[LocatedArray]:
    """Images of one array whose first index counts them."""
    if len(stack.shape) < 3 or stack.fortran_order or not stack.shape[0]:
        return []
    offset, length = stack.place.offset, stack.place.length // stack.shape[0]
    if length < FEWEST_BYTES:
        return []
    return [
        LocatedArray(stack.shape[1:], stack.dtype, False, Place(offset + k * length, length))
        for k in range(stack.shape[0])
    ]


class _Reader:
    """Reads pairs, the file being open only meanwhile."""

    def __init__(self, path: Path, left: _Side, right: _Side):
        self._path, self._left, self._right = path, left, right

    def __call__(self, places: Sequence[int]) -> Iterator[tuple[RawImage, RawImage]]:
        with open_input(self._path, "these images") as file:
            for place in places:
                yield (
                    self._left.read(file, self._path, place),
                    self._right.read(file, self._path, place),
                )
