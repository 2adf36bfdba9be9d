# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The course's images stay in their file, whatever numpy wrote it, and nothing in it is run."""

import io
import pickle
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from course_files import READINGS, save_course_file
from imagery.folders import (
    FRAMES,
    STAMPS,
    T_BODY_LEFT,
    K,
    course_images,
    pair,
    write_course,
    write_dataset,
)

from vislam_ros.core.geometry import se3
from vislam_ros.data.image_sources import read_images
from vislam_ros.data.images.folders.array_places import LocatedArray, locate_arrays
from vislam_ros.data.trajectory import NANOSECONDS
from vislam_ros.errors import VislamError


def write_images(path: Path, content: Any, protocol: int = 4) -> Path:
    """As numpy.save does, by any protocol."""
    holder = np.empty((), dtype=object)
    holder[()] = content
    header = {"descr": "|O", "fortran_order": False, "shape": ()}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
        pickle.dump(holder, file, protocol=protocol)
    return path


@pytest.mark.parametrize("protocol", [3, 4, 5])
@pytest.mark.parametrize("order", ["C", "F"])
def test_every_protocol_and_order_gives_the_same_images(
    protocol: int, order: Any, tmp_path: Path
) -> None:
    write_dataset(tmp_path / "drive.npz")
    content = {
        key: [np.asarray(each, order=order) for each in images]
        for key, images in course_images().items()
    }
    path = write_images(tmp_path / "drive_imgs.npy", content, protocol)
    for k, (_, left, right) in enumerate(read_images(path).pairs()):
        np.testing.assert_array_equal(left.pixels, pair(k)[0])
        np.testing.assert_array_equal(right.pixels, pair(k)[1])


def test_images_may_be_stacked_or_coloured(tmp_path: Path) -> None:
    write_dataset(tmp_path / "drive.npz")
    stacked: Any = {
        key: np.stack([np.dstack([each, each, each]) for each in images])
        for key, images in course_images().items()
    }
    path = write_images(tmp_path / "drive_imgs.npy", stacked)
    *_, (_, left, _) = read_images(path).pairs()
    assert left.encoding == "bgr8"
    np.testing.assert_array_equal(left.pixels[..., 1], pair(FRAMES - 1)[0])


def test_images_are_read_one_pair_at_a_time(tmp_path: Path) -> None:
    write_dataset(tmp_path / "drive.npz")
    rng = np.random.default_rng(3)
    images = [rng.integers(0, 255, (960, 1280), dtype=np.uint8) for _ in range(FRAMES)]
    path = tmp_path / "drive_imgs.npy"
    write_images(path, {"cam_imgs_L": images, "cam_imgs_R": [each.copy() for each in images]})
    del images
    read_images(path)  # what is imported for it does not count
    tracemalloc.start()
    for _ in read_images(path).pairs():
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < path.stat().st_size / 2


def test_the_dataset_beside_may_be_given_by_name_instead(tmp_path: Path) -> None:
    images = write_course(tmp_path / "course")
    elsewhere = (images.with_name("dataset00.npz")).rename(tmp_path / "motion.npz")
    with pytest.raises(VislamError, match=r"holds images alone: put their dataset dataset00\.npy"):
        read_images(images)
    assert len(read_images(images, elsewhere)) == FRAMES


def test_more_images_than_frames_of_the_motion_are_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "drive.npz")
    content = {key: [*images, images[0]] for key, images in course_images().items()}
    path = write_images(tmp_path / "drive_imgs.npy", content)
    with pytest.raises(VislamError, match=r"drive\.npz: has 8 frames, none for image 8 of drive"):
        read_images(path)


def test_a_missing_partner_is_noted(tmp_path: Path) -> None:
    write_dataset(tmp_path / "drive.npz")
    content = course_images()
    content["cam_imgs_R"].pop()
    images = read_images(write_images(tmp_path / "drive_imgs.npy", content))
    assert len(images) == FRAMES - 1
    assert "Left out 1 images without a partner." in images.notes


@pytest.mark.parametrize("reading", ["imu-to-optical", "flu-to-imu"])
def test_both_cameras_stand_as_the_dataset_says(reading: str, tmp_path: Path) -> None:
    K_right = K + np.array([[2.0, 0.0, -3.0], [0.0, 1.0, 4.0], [0.0, 0.0, 0.0]])
    T_left_right = se3.exp([0.1, 0.01, -0.005, 0.02, -0.01, 0.03])
    stored = READINGS[reading]
    arrays: Any = {
        "v_t": np.zeros((FRAMES, 3)),
        "w_t": np.zeros((FRAMES, 3)),
        "timestamps": STAMPS / NANOSECONDS,
        "K_l": K,
        "K_r": K_right,
        "extL_T_imu": stored(T_BODY_LEFT),
        "extR_T_imu": stored(T_BODY_LEFT @ T_left_right),
    }
    save_course_file(tmp_path / "drive.npy", arrays)
    images = read_images(write_images(tmp_path / "drive_imgs.npy", course_images()))
    np.testing.assert_allclose(images.rig.left.K, K, atol=1e-9)
    np.testing.assert_allclose(images.rig.right.K, K_right, atol=1e-9)
    np.testing.assert_allclose(images.rig.T_left_right, T_left_right, atol=1e-9)
    np.testing.assert_allclose(images.rig.T_body_left, T_BODY_LEFT, atol=1e-9)


class _Evil:
    def __reduce__(self) -> Any:
        return Path.touch, (Path("touched"),)


WRONG: dict[str, tuple[Any, str]] = {
    "code": ({"cam_imgs_L": [_Evil()]}, "which is refused: only numpy arrays and plain"),
    "no images": ({"pictures": []}, "cam_imgs_L holds no images"),
    "other types": ({"cam_imgs_L": [np.zeros((40, 40))] * 2}, r"cam_imgs_L\[0\] is no image"),
    "other sizes": (
        {"cam_imgs_L": [np.zeros((40, 40), np.uint8), np.zeros((40, 41), np.uint8)]},
        r"cam_imgs_L\[1\] is no image",
    ),
    "one image": ({"cam_imgs_L": np.zeros((40, 40), np.uint8)}, "cam_imgs_L holds no images"),
    "specks": ({"cam_imgs_L": np.zeros((2000, 1, 1), np.uint8)}, "cam_imgs_L holds no images"),
    "nothing": (None, "cam_imgs_L holds no images"),
    "sets": ({"cam_imgs_L": {1, 2}}, "holds more than arrays and plain containers"),
}


@pytest.mark.parametrize(("content", "reason"), WRONG.values(), ids=WRONG)
def test_what_holds_no_images_is_refused_in_a_line(
    content: Any, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_dataset(tmp_path / "drive.npz")
    path = write_images(tmp_path / "drive_imgs.npy", content)
    with pytest.raises(VislamError, match=reason) as caught:
        read_images(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not Path("touched").exists()


def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    write_dataset(tmp_path / "drive.npz")
    path = write_images(tmp_path / "drive_imgs.npy", course_images())
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 40).astype(int).tolist():
        path.write_bytes(whole[:length])
        with pytest.raises(VislamError, match=r"cut off or damaged|is no file of images"):
            read_images(path)


HOSTILE = {
    "a length beyond the end": b"\x80\x04\x8e" + (1 << 60).to_bytes(8, "little") + b"x.",
    "an array larger than its bytes": pickle.dumps(
        np.zeros((40, 40), np.uint8), protocol=4
    ).replace(b"K(K(", b"K(K)"),
    "lists without end": b"\x80\x04" + b"]" * 5000 + b".",
    "itself": b"\x80\x04]\x94h\x00a" * 2000 + b".",
    "a place in the memo that is not there": b"\x80\x04h\x05.",
    "an integer of many digits": b"\x80\x04\x8a\xff" + b"\x01" * 255 + b".",
    "nothing on the stack": b"\x80\x04R.",
    "a mark for a value": b"\x80\x04(.",
}


@pytest.mark.parametrize("data", HOSTILE.values(), ids=HOSTILE)
def test_hostile_pickles_are_refused_at_once(data: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(VislamError, match="cut off or damaged"):
            locate_arrays(io.BytesIO(data), "file.npy")
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 4 << 20


def test_arrays_are_located_not_read() -> None:
    array = np.arange(2000, dtype=">i4").reshape(50, 40)
    stream = io.BytesIO(pickle.dumps({"a": array}, protocol=4))
    found = locate_arrays(stream, "file.npy")["a"]
    assert isinstance(found, LocatedArray)
    assert (found.shape, found.dtype, found.fortran_order) == ((50, 40), array.dtype, False)
    offset, length = found.place
    assert stream.getvalue()[offset : offset + length] == array.tobytes()
