# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion from a dataset or a bag, for images that another file holds."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.core.geometry.pixel_rectification import PixelRectification
from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.data.datasets.conventions import Conventions
from vislam_ros.data.drive import Drive
from vislam_ros.data.images.pairing import half_a_period, pair_stamps
from vislam_ros.data.images.reference_poses import from_first_pose, of_another_body
from vislam_ros.data.images.stereo_images import Motion, StereoImages
from vislam_ros.data.trajectory import Trajectory
from vislam_ros.errors import VislamError

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True)
class GivenMotion:
    """What a dataset or a bag tells beside its features.

    Attributes
    ----------
    source : str
        What to call it in an error.
    motion : Motion
    frames : ndarray of int64, (T,), or None
        Stamps of its own feature frames, nanoseconds, where it has some.
    camera : StereoCamera or None
        Its rectified camera, where it has one.
    rectification : PixelRectification or None
        What pixels of its raw cameras go through to be those of ``camera``; None where they are.
    ground_truth : Trajectory or None
    unsettled : Conventions or None
        How to find what the twists mean, where the source has no features that told it.
    notes : tuple of str
    """

    source: str
    motion: Motion
    frames: Stamps | None = None
    camera: StereoCamera | None = None
    rectification: PixelRectification | None = None
    ground_truth: Trajectory | None = None
    unsettled: Conventions | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of_drive(
        cls, drive: Drive, source: str, rectification: PixelRectification | None = None
    ) -> "GivenMotion":
        """Motion, stamps, camera and truth of a drive."""
        return cls(
            source=source,
            motion=Motion(drive.twist_stamps, drive.twists, drive.accelerations),
            frames=drive.feature_stamps if drive.steps else None,
            camera=drive.camera,
            rectification=rectification,
            ground_truth=drive.ground_truth,
            notes=drive.notes,
        )


def with_motion(images: StereoImages, given: GivenMotion) -> StereoImages:
    """Give images the motion of another source, its stamps, extrinsics and truth.

    Frames of both are the same ones where each image's stamp is nearest to a frame's within half a
    period, or where the images have no times, or times of another clock that run alike: then the
    first image is of the first frame. Where the other source has no frames, both tell the time by
    one clock.

    Raises
    ------
    VislamError
        Where their times have nothing in common.
    """
    if given.frames is None:
        return _moved(_of_one_clock(images, given), given)
    return _moved(_of_frames(images, given.frames, given.source), given)


def _of_one_clock(images: StereoImages, given: GivenMotion) -> StereoImages:
    first, last = given.motion.stamps[[0, -1]].tolist()
    if not images.timed or images.stamps[0] > last or images.stamps[-1] < first:
        raise VislamError(
            f"{given.source}: tells the motion from {first} to {last} ns, which is not the time "
            f"of {images.name}: give the motion that was recorded with the images"
        )
    return images


def _of_frames(images: StereoImages, frames: Stamps, source: str) -> StereoImages:
    """Images with the stamps of their frames."""
    stamps = images.stamps
    if not images.timed:
        if stamps[-1] >= len(frames):
            raise VislamError(
                f"{source}: has {len(frames)} frames, none for image {stamps[-1]} of "
                f"{images.name}: give the motion that was recorded with the images"
            )
        taken = images.at(np.arange(len(stamps)), frames[stamps])
        return replace(
            taken, notes=(*images.notes, "The images have the stamps of the motion's frames.")
        )
    tolerance = half_a_period(stamps)
    pairs = pair_stamps(stamps, frames, tolerance)
    notes: list[str] = []
    if not len(pairs.first):
        pairs = pair_stamps(stamps - stamps[0] + frames[0], frames, tolerance)
        if len(pairs.first) < len(stamps):
            raise VislamError(
                f"{source}: none of its {len(frames)} frames is at the time of an image of "
                f"{images.name}: give the motion that was recorded with the images"
            )
        notes.append(
            "The images' clock is not the motion's: their first frames are taken for one."
        )
    elif missing := len(stamps) - len(pairs.first):
        notes.append(f"Left out {missing} images without a frame of the motion.")
    taken = images.at(pairs.first, frames[pairs.second])
    return replace(taken, notes=(*images.notes, *notes))


def _moved(images: StereoImages, given: GivenMotion) -> StereoImages:
    """Images on the body of a motion."""
    truth = given.ground_truth
    if truth is not None:
        truth = from_first_pose(truth.stamps, truth.T_world_body, images.stamps)
    rig = images.rig
    if given.camera is not None:
        T_body_left = raw_extrinsics(given.camera, given.rectification)
        if T_body_left is None:
            T_body_left = _extrinsics_before_rectification(rig, given.camera)
        rig = replace(rig, T_body_left=T_body_left)
    if truth is None and images.ground_truth is not None:
        T_old_new = images.rig.T_body_left @ se3.inverse(rig.T_body_left)
        truth = of_another_body(images.ground_truth, T_old_new)
    return replace(
        images,
        rig=rig,
        motion=given.motion,
        unsettled=given.unsettled,
        turns=None,
        is_of_graph=False,
        ground_truth=truth,
        notes=(*images.notes, *given.notes),
    )


def raw_extrinsics(camera: StereoCamera, rectification: PixelRectification | None) -> Array | None:
    """Pose (4, 4) in the body of the left camera whose turn is told; None where none is."""
    turn = None if rectification is None else rectification.left
    if turn is None or turn.R_after_before is None:
        return None
    T_rectified_left = np.eye(4)
    T_rectified_left[:3, :3] = np.reshape(turn.R_after_before, (3, 3))
    return camera.T_body_camera @ T_rectified_left


def _extrinsics_before_rectification(rig: StereoRig, camera: StereoCamera) -> Array:
    """Pose (4, 4) of the raw left camera in the body, from that of the rectified one."""
    # It brings OpenCV, which takes a while to import.
    from vislam_ros.frontend.rectification import Rectification

    at_home = replace(rig, T_body_left=np.eye(4))
    T_left_rectified = Rectification(at_home).camera.T_body_camera
    return camera.T_body_camera @ se3.inverse(T_left_rectified)
