# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from vislam_ros.core.geometry import se3
from vislam_ros.core.geometry.stereo_rig import RawCamera, StereoRig
from vislam_ros.errors import VislamError
from vislam_ros.frontend.rectification import Rectification

Array = NDArray[np.float64]
SIZE = 320, 240
LENSES: dict[str, tuple[str, list[float]]] = {
    "none": ("", []),
    "radial and tangential": ("plumb_bob", [-0.28, 0.07, 2e-4, -1e-4]),
    "with a fifth": ("plumb_bob", [-0.28, 0.07, 2e-4, -1e-4, 0.01]),
    "rational": ("rational_polynomial", [0.9, 0.2, 1e-4, 2e-4, 0.02, 1.2, 0.4, 0.03]),
    "fisheye": ("equidistant", [0.02, -0.01, 0.004, -0.001]),
}


def raw(lens: str, shift: float = 0.0) -> RawCamera:
    model, D = LENSES[lens]
    K = np.array([[200.0 + shift, 0, 158 + shift], [0, 201, 122 - shift], [0, 0, 1]])
    return RawCamera(SIZE, K, model, np.array(D))


def rig(lens: str, other: str | None = None) -> StereoRig:
    T_left_right = se3.exp(np.array([0.12, 0.002, -0.003, 0.01, -0.02, 0.015]))
    T_body_left = se3.pose_matrix([0.1, -0.2, 0.3], [0.5, -0.5, 0.5, -0.5])
    return StereoRig(raw(lens), raw(other or lens, 3.0), T_left_right, T_body_left)


def raw_pixels(camera: RawCamera, points: Array) -> Array:
    """Pixels (n, 2) of points (n, 3) in the camera's own axes."""
    project: Any = (
        cv2.fisheye.projectPoints
        if camera.distortion_model == "equidistant"
        else cv2.projectPoints
    )
    D = camera.D if len(camera.D) else np.zeros(4)
    if camera.distortion_model == "equidistant":
        pixels, _ = project(points[:, None], np.zeros(3), np.zeros(3), camera.K, D)
    else:
        pixels, _ = project(points, np.zeros(3), np.zeros(3), camera.K, D)
    return np.asarray(pixels, dtype=float).reshape(-1, 2)


def spot(pixel: Array) -> NDArray[np.uint8]:
    """Image with a soft spot at a pixel."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    square = (x - pixel[0]) ** 2 + (y - pixel[1]) ** 2
    return np.asarray(np.rint(250 * np.exp(-square / 8)), np.uint8)


def middle(image: NDArray[np.uint8]) -> Array:
    moments = cv2.moments(image)
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


@pytest.mark.parametrize(
    ("lens", "other"), [(lens, None) for lens in LENSES] + [("fisheye", "rational")]
)
def test_a_point_is_where_the_rectified_camera_sees_it(lens: str, other: str | None) -> None:
    given = rig(lens, other)
    rectification = Rectification(given)
    camera = rectification.camera
    assert rectification.image_size == SIZE
    for point in ([0.2, -0.1, 1.5], [-0.4, 0.3, 2.0], [0.0, 0.0, 8.0]):
        in_body = given.T_body_left @ [*point, 1.0]
        in_right = se3.inverse(given.T_left_right) @ [*point, 1.0]
        left = spot(raw_pixels(given.left, np.array([point]))[0])
        right = spot(raw_pixels(given.right, in_right[None, :3])[0])
        seen = [middle(image) for image in rectification.rectify(left, right)]
        expected = camera.project((camera.T_camera_body @ in_body)[:3])
        assert_allclose([*seen[0], *seen[1]], expected[[0, 2, 1, 2]], atol=0.15)


@pytest.mark.parametrize("lens", LENSES)
def test_the_rectified_images_are_filled(lens: str) -> None:
    rectification = Rectification(rig(lens))
    white = np.full(SIZE[::-1], 255, np.uint8)
    for image in rectification.rectify(white, white):
        assert np.mean(image == 255) > 0.99


def test_a_rectified_pair_passes_bit_for_bit() -> None:
    left = raw("none")
    T_left_right = se3.pose_matrix([0.5, 0, 0], [0, 0, 0, 1])
    given = StereoRig(left, left, T_left_right, rig("none").T_body_left)
    rectification = Rectification(given)
    images = np.random.default_rng(0).integers(0, 255, (2, 240, 320), dtype=np.uint8)
    for image, before in zip(rectification.rectify(*images), images, strict=True):
        assert np.shares_memory(image, before)
    camera = rectification.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (200.0, 201.0, 158.0, 122.0)
    assert camera.baseline == pytest.approx(0.5)
    assert_allclose(camera.T_body_camera, given.T_body_left, atol=1e-12)


@pytest.mark.parametrize("what", ["turned", "up", "other K", "distorted"])
def test_a_pair_that_is_not_quite_rectified_does_not_pass(what: str) -> None:
    left = raw("none")
    T = se3.pose_matrix([0.5, 0, 0], [0, 0, 0, 1])
    right = left
    if what == "turned":
        T = T @ se3.exp(np.array([0, 0, 0, 0, 1e-4, 0]))
    elif what == "up":
        T[1, 3] = 1e-4
    elif what == "other K":
        right = raw("none", 0.01)
    else:
        right = dataclasses.replace(
            left, distortion_model="plumb_bob", D=np.array([1e-3, 0, 0, 0])
        )
    image = np.random.default_rng(0).integers(0, 255, (240, 320), dtype=np.uint8)
    result, _ = Rectification(StereoRig(left, right, T, np.eye(4))).rectify(image, image)
    assert not np.shares_memory(result, image)


def test_a_wide_fisheye_shows_what_a_flat_image_can() -> None:
    wide = dataclasses.replace(
        raw("fisheye"), K=np.array([[100.0, 0, 160], [0, 100, 120], [0, 0, 1]]), D=np.zeros(4)
    )
    T = se3.pose_matrix([0.1, 0, 0], [0, 0, 0, 1])
    camera = Rectification(StereoRig(wide, wide, T, np.eye(4))).camera
    # The raw image reaches to 92 degrees; the rectified one to less than 63 at the corners.
    corner = np.hypot(max(camera.cx, 319 - camera.cx), max(camera.cy, 239 - camera.cy)) / camera.fx
    assert 1.0 < corner <= 2.01


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"T_left_right": se3.pose_matrix([-0.1, 0, 0], [0, 0, 0, 1])}, "exchanged"),
        ({"T_left_right": se3.pose_matrix([0.01, 0.1, 0], [0, 0, 0, 1])}, "to the right"),
        ({"T_left_right": np.eye(4)}, "to the right"),
        ({"T_left_right": np.full((4, 4), np.nan)}, "not finite"),
        (
            {"T_left_right": se3.pose_matrix([0.1, 0, 0], [0, np.sin(1.2), 0, np.cos(1.2)])},
            "nothing in common",
        ),
        ({"left": RawCamera(SIZE, np.eye(3), "fov", np.zeros(1))}, "left camera: distortion.*fov"),
        ({"right": RawCamera(SIZE, np.eye(3), "plumb_bob", np.zeros(3))}, "3 coefficients, not 4"),
        ({"right": RawCamera(SIZE, np.eye(3), "", np.ones(4))}, "no distortion model"),
        ({"left": RawCamera(SIZE, np.zeros((3, 3)), "", np.zeros(0))}, "no positive focal"),
        (
            {"left": RawCamera(SIZE, np.eye(3), "plumb_bob", np.full(4, np.inf))},
            "not finite",
        ),
    ],
)
def test_a_rig_that_makes_no_sense_is_told(change: dict[str, Any], message: str) -> None:
    with pytest.raises(VislamError, match=message):
        Rectification(dataclasses.replace(rig("none"), **change))


def test_an_image_of_another_size_is_told() -> None:
    rectification = Rectification(rig("none"))
    good, wrong = np.zeros((240, 320), np.uint8), np.zeros((240, 321), np.uint8)
    with pytest.raises(VislamError, match=r"right image: is \(240, 321\).*320 x 240"):
        rectification.rectify(good, wrong)
