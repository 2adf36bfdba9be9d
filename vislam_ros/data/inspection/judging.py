# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All that is wrong with a drive in tracks.

Images alone tell first whether their sides, their size and the right camera are as they should be;
what they say of the motion counts once that is undone.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import threadpoolctl

from vislam_ros.data.datasets.conventions import in_radians, is_in_degrees, reprojection_errors
from vislam_ros.data.datasets.mending import AS_STORED, Mending, inverted
from vislam_ros.data.datasets.step_pairs import step_pairs
from vislam_ros.data.drive import Drive, image_size_that_holds
from vislam_ros.data.finding import NAMES, Finding
from vislam_ros.data.inspection import gyro_bias, moving_tracks
from vislam_ros.data.inspection.disparities import (
    are_swapped,
    disparities_of,
    exchanged,
    judge_disparities,
    swapped,
)
from vislam_ros.data.inspection.gyro_bias import judge_gyro_bias
from vislam_ros.data.inspection.motion import judge_motion
from vislam_ros.data.inspection.moving_tracks import judge_moving_tracks, tracks_off
from vislam_ros.data.inspection.pixel_scale import judge_pixel_scale
from vislam_ros.data.inspection.right_camera import corrected, judge_right_camera
from vislam_ros.data.inspection.step_motions import step_motions
from vislam_ros.data.inspection.walk import judge_frozen_steps, walk

#: Reads a drive anew, with faults undone.
Reread = Callable[[Mending], Drive]

_LEFT_OF_ERROR = 0.5
_OF_IMAGES = tuple(name for name in NAMES if name not in ("stamps", "contradiction"))


class Judged(NamedTuple):
    """What is wrong with a drive, and what of it could not be looked at.

    Attributes
    ----------
    findings : list of Finding
    unknown : dict of str to str
        Why something was not judged, by the finding's name.
    drive : Drive
        With the faults undone that were found.
    """

    findings: list[Finding]
    unknown: dict[str, str]
    drive: Drive


def judge(drive: Drive, reread: Reread | None = None, mending: Mending = AS_STORED) -> Judged:
    """Judge a drive.

    Parameters
    ----------
    drive : Drive
        As it was read.
    reread : callable, optional
        Reads it anew with faults undone, where reading itself judges by the images.
    mending : Mending, optional
        What was undone in reading it so far.
    """
    again = reread or (lambda more: mended(drive, more))
    with threadpoolctl.threadpool_limits(1):
        return _judge(drive, again, mending)


def mended(drive: Drive, mending: Mending) -> Drive:
    """Drive with faults of its pixels and extrinsics undone."""
    pixels = exchanged(drive.pixels) if mending.swaps_sides else drive.pixels
    pixels = pixels * np.float32(mending.pixel_scale)
    camera = mending.camera(drive.camera)
    return replace(drive, pixels=pixels, camera=camera, image_size=image_size_that_holds(pixels))


def _judge(drive: Drive, again: Reread, mending: Mending) -> Judged:
    found: list[Finding] = []
    if is_in_degrees(drive):
        found, drive = list(drive.findings), replace(in_radians(drive), findings=())
        again = _in_radians(again)
    disparities = disparities_of(drive)
    if are_swapped(disparities):
        found.append(swapped(disparities))
        mending = replace(mending, swaps_sides=not mending.swaps_sides)
        drive = again(mending)
    if scale := judge_pixel_scale(drive):
        found.append(scale)
        mending = replace(mending, pixel_scale=float(scale.numbers["scale"]))
        drive = again(mending)
    if right := judge_right_camera(drive):
        found.append(right)
        drive = corrected(drive, right)
    walked = walk(drive)
    of_motion = judge_motion(walked.reasons)
    if of_motion and not mending.inverts_extrinsics:
        if inverse := _inverse(drive, again, mending):
            other, as_given, as_inverse = inverse
            drive = corrected(other, right) if right else other
            walked = walk(drive)
            wrong = Finding(
                "extrinsics_inverted",
                f"images and twists are off by {as_given:.1f} px a step, and by {as_inverse:.1f} "
                "px with the inverse of the extrinsics",
                "give the inverse of the extrinsics",
                False,
                of_motion[0].numbers,
            )
            of_motion = [wrong, *judge_motion(walked.reasons)]
        elif any(each.name == "extrinsics_inverted" for each in of_motion):
            drive = replace(drive, camera=inverted(drive.camera))
            walked = walk(drive)
    if right:
        # Depths are as wrong as its columns may still be, and so is what they contradict.
        of_motion = [each for each in of_motion if each.name != "contradiction"]
    found += [*drive.findings, *of_motion]
    if frozen := judge_frozen_steps(drive, walked):
        found.append(frozen)
    motions = step_motions(drive)
    off = tracks_off(motions)
    of_tracks = (
        judge_disparities(drive),
        judge_gyro_bias(motions),
        None if off is None else judge_moving_tracks(*off),
    )
    found += [finding for finding in of_tracks if finding is not None]
    if not len(drive.pixels):
        return Judged(found, dict.fromkeys(_OF_IMAGES, "there are no features"), drive)
    unknown = {}
    if len(motions.turn_errors) < gyro_bias.FEWEST_STEPS:
        unknown["gyro_bias"] = (
            f"{len(motions.turn_errors)} steps have tracks enough to tell the turn, "
            f"{gyro_bias.FEWEST_STEPS} are needed"
        )
    if off is None:
        unknown["moving_tracks"] = f"{moving_tracks.FEWEST_TRACKS} longer tracks are needed"
    if not walked.looks.rigid:
        unknown["extrinsics_inverted"] = "no step has tracks enough to tell its motion"
    return Judged(found, unknown, drive)


def _in_radians(again: Reread) -> Reread:
    """Read a drive whose angular velocity is in degrees, with that undone, too."""

    def reread(mending: Mending) -> Drive:
        return replace(in_radians(again(mending)), findings=())

    return reread


def _inverse(drive: Drive, again: Reread, mending: Mending) -> tuple[Drive, float, float] | None:
    """Drive with its extrinsics inverted, where that fits its images far better.

    With it come the median errors as given and with the inverse, pixels.
    """
    if not drive.measures_velocity or len(drive.twists) != drive.steps:
        return None
    other = again(replace(mending, inverts_extrinsics=True))
    errors = []
    for each in (drive, other):
        of_steps = reprojection_errors(each, step_pairs(each))
        if not len(of_steps):
            return None
        errors.append(float(np.median(of_steps)))
    as_given, as_inverse = errors
    return (other, as_given, as_inverse) if as_inverse < _LEFT_OF_ERROR * as_given else None
