# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What images are, by some of them, and what is wrong with their tracks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.stereo_rig import StereoRig
from vislam_ros.data.images.stereo_images import StereoImages
from vislam_ros.data.images.tracking import tracked_drive
from vislam_ros.data.inspection.facts import facts_of
from vislam_ros.data.inspection.inspecting import Inspection
from vislam_ros.data.inspection.judging import judge
from vislam_ros.data.inspection.streams import Stream, judge_stamps
from vislam_ros.frontend.grey import GreyStream

# Frames that are looked at one by one, and those that are tracked.
_LOOKED_AT, _TRACKED = 12, 60
# Of eight bits: what is as dark or as light as it can be told.
_DARK, _LIGHT = 5, 250
_NO_DISTORTION = 1e-12


def inspect_images(told: Inspection, images: StereoImages) -> None:
    """Take what images are, and what is wrong with them."""
    told.facts = _facts(images)
    streams = [Stream.of("frames", images.stamps)] if images.timed else []
    if images.motion is not None:
        streams.append(Stream.of("motion", images.motion.stamps))
    told.streams = tuple(streams)
    if wrong := judge_stamps(told.streams):
        told.findings.append(wrong)
    if images.motion is None or not images.timed:
        what = "the motion" if images.motion is None else "the times of the images"
        told.unknown["contradiction"] = f"nothing tells {what}: give it with --motion"
        return
    # Where it turns the most, most can be told.
    rows = _busiest(images)
    drive = tracked_drive(images.at(rows, images.stamps[rows]))
    judged = judge(drive)
    of_tracks = facts_of(judged.drive)
    told.facts |= {
        key: of_tracks[key]
        for key in ("observations_a_frame", "track_length_mean", "disparity_px", "depth_m")
    }
    told.facts["tracked_frames"] = drive.steps
    told.facts["tracks"] = of_tracks["tracks"]
    told.findings += judged.findings
    told.unknown |= judged.unknown


def _busiest(images: StereoImages) -> NDArray[np.intp]:
    """Frames in a row in which the body turns the most."""
    n = len(images)
    if n <= _TRACKED or images.motion is None:
        return np.arange(min(n, _TRACKED))
    turn = np.linalg.norm(images.motion.twists[:, 3:], axis=1)
    at_frames = np.interp(images.stamps, images.motion.stamps, turn)
    sums = np.convolve(at_frames, np.ones(_TRACKED), mode="valid")
    begin = int(np.argmax(sums))
    return np.arange(begin, begin + _TRACKED)


def _facts(images: StereoImages) -> dict[str, Any]:
    rows = np.unique(np.linspace(0, len(images) - 1, _LOOKED_AT).astype(int))
    encodings: set[str] = set()
    sizes: set[tuple[int, int]] = set()
    dark, light, mean, contrast = [], [], [], []
    greys = GreyStream(), GreyStream()
    for pair in images.at(rows, images.stamps[rows]).pairs():
        for stream, image in zip(greys, (pair.left, pair.right), strict=True):
            encodings.add(image.encoding)
            sizes.add((image.pixels.shape[1], image.pixels.shape[0]))
            plain = stream.grey(*image)
            dark.append(float(np.mean(plain <= _DARK)))
            light.append(float(np.mean(plain >= _LIGHT)))
            mean.append(float(plain.mean()))
            contrast.append(float(plain.std()))
    motion, rig = images.motion, images.rig
    return {
        "frames": len(images),
        "duration_s": float(images.stamps[-1] - images.stamps[0]) * 1e-9 if images.timed else None,
        "image_size": [list(size) for size in sorted(sizes)],
        "encodings": sorted(encodings),
        "rectified": is_rectified(rig),
        "dark_share": float(np.mean(dark)),
        "saturated_share": float(np.mean(light)),
        "brightness": float(np.mean(mean)),
        "brightness_changes": float(np.std(mean)),
        "contrast": float(np.mean(contrast)),
        "motion_samples": 0 if motion is None else len(motion.stamps),
        "measures_velocity": motion is not None and not np.isnan(motion.twists[:, :3]).any(),
        "measures_acceleration": motion is not None and motion.accelerations is not None,
        "focal_length_px": [float(rig.left.K[0, 0]), float(rig.left.K[1, 1])],
        "baseline_m": float(np.linalg.norm(rig.T_left_right[:3, 3])),
        "lens": rig.left.distortion_model or "none",
        "ground_truth_poses": 0 if images.ground_truth is None else len(images.ground_truth),
    }


def is_rectified(rig: StereoRig) -> bool:
    """Whether images are those of a rectified pair, as their rig says."""
    T = rig.T_left_right
    straight = np.allclose(T[:3, :3], np.eye(3), atol=1e-6) and np.allclose(
        T[1:3, 3], 0.0, atol=1e-6 * abs(T[0, 3])
    )
    lenses = any(np.any(np.abs(each.D) > _NO_DISTORTION) for each in (rig.left, rig.right))
    return bool(straight and not lenses and np.allclose(rig.left.K, rig.right.K))
