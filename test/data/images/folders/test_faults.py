# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Folders with something missing are read as far as they go; what is wrong is named in a line."""

import re
import shutil
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imagery.folders import (
    FRAMES,
    PERIOD,
    STAMPS,
    START,
    write_asl,
    write_dataset,
    write_kitti_odometry,
    write_kitti_raw,
)

from vislam_ros.data.image_sources import is_images, read_images, read_motion
from vislam_ros.errors import VislamError

Fault = Callable[[Path], object]


def edit(name: str, old: str, new: str) -> Fault:
    """Put another text in the place of one in a file."""

    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def gone(name: str) -> Fault:
    return lambda folder: (folder / name).unlink()


def claim_pixels(folder: Path) -> None:
    """A PNG of a few bytes that claims ten thousand megapixels."""
    header = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    path = folder / f"mav0/cam0/data/{STAMPS[0]}.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)


ASL: dict[str, tuple[Fault, str]] = {
    "no table": (gone("mav0/cam1/data.csv"), "mav0: has no cam1/data.csv: both cameras' tables"),
    "one camera": (
        lambda folder: shutil.rmtree(folder / "mav0" / "cam1"),
        "mav0: has no cam1/data.csv",
    ),
    "an empty table": (
        lambda folder: (folder / "mav0" / "cam0" / "data.csv").write_text("# no rows\n"),
        "cam0/data.csv: holds no row of a stamp and a file's name",
    ),
    "no name of a lens": (
        edit("mav0/cam0/sensor.yaml", "distortion_model: radial-tangential\n", ""),
        "cam0/sensor.yaml: distortion_model is missing, of which distortion_coefficients are",
    ),
    "one place for both": (
        lambda folder: shutil.copy(
            folder / "mav0" / "cam0" / "sensor.yaml", folder / "mav0" / "cam1" / "sensor.yaml"
        ),
        "V1_01: T_left_right: the right camera stands at [0.0, 0.0, 0.0] m, not to the right",
    ),
    "no calibration": (gone("mav0/cam0/sensor.yaml"), "cam0/sensor.yaml: cannot read this"),
    "no YAML": (edit("mav0/cam0/sensor.yaml", "T_BS:", "T_BS: ["), "sensor.yaml, line"),
    "no pose": (edit("mav0/cam0/sensor.yaml", "T_BS", "T_SB"), "T_BS is None: give 16 finite"),
    "no rotation": (edit("mav0/cam1/sensor.yaml", "-1.0", "-2.0"), "no pose [[R, p], [0, 1]]"),
    "another lens": (
        edit("mav0/cam0/sensor.yaml", "radial-tangential", "fov"),
        "distortion_model is 'fov': calibrate it as one of none, radtan",
    ),
    "another camera": (
        edit("mav0/cam0/sensor.yaml", "pinhole", "omni"),
        "camera_model is 'omni': calibrate it as a pinhole",
    ),
    "three numbers": (
        edit("mav0/cam0/sensor.yaml", "[0.0, 0.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]"),
        "distortion_coefficients is [0.0, 0.0, 0.0]: give 4 or 5 finite numbers",
    ),
    "another size": (
        edit("mav0/cam1/sensor.yaml", "[160, 120]", "[640, 480]"),
        "has 160 x 120 pixels, and its camera 640 x 480",
    ),
    "no stamp": (
        edit("mav0/cam0/data.csv", f"{STAMPS[2]},", "soon,"),
        "line 4 begins with 'soon', no stamp in nanoseconds",
    ),
    "a stamp beyond": (
        edit("mav0/cam0/data.csv", f"{STAMPS[2]},", "99999999999999999999,"),
        "no stamp in nanoseconds",
    ),
    "a name that leads away": (
        edit("mav0/cam0/data.csv", f",{STAMPS[2]}", f",../{STAMPS[2]}"),
        "line 4 names no file after its stamp, but '../14",
    ),
    "no angular velocity": (
        edit("mav0/imu0/data.csv", "0.003", "nan"),
        "imu0/data.csv: line 2 is no row of a stamp and 6 finite numbers",
    ),
    "too fast a turn": (
        edit("mav0/imu0/data.csv", "0.003", "3e9"),
        "an angular velocity of 3e+09",
    ),
    "an alias": (edit("mav0/cam0/sensor.yaml", "T_BS:", "a: &x 1\nb: *x\nT_BS:"), "an alias"),
    "a claim": (claim_pixels, "claims 100000 x 100000 pixels, which no camera has"),
}


@pytest.mark.parametrize(("fault", "reason"), ASL.values(), ids=ASL)
def test_faults_of_an_asl_folder_are_named(fault: Fault, reason: str, tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    fault(folder)
    with pytest.raises(VislamError, match=re.escape(reason)) as caught:
        list(read_images(folder).pairs())
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("write", "files"),
    [
        (write_asl, ("mav0/cam0/data.csv", "mav0/imu0/data.csv", "mav0/cam1/sensor.yaml")),
        (write_kitti_odometry, ("calib.txt", "times.txt", "../poses/drive.txt")),
        (write_kitti_raw, ("image_00/timestamps.txt", "oxts/data/0000000002.txt")),
    ],
)
def test_files_of_another_editor_are_the_same(
    write: Callable[[Path], Path], files: tuple[str, ...], tmp_path: Path
) -> None:
    """Some begin with a byte order mark, end lines as Windows does and write a degree's sign."""
    folder = write(tmp_path / "drive")
    plain = read_images(folder)
    for name in files:
        text = (folder / name).read_text().replace("# ", "# °").replace("#t", "#°t")
        (folder / name).write_bytes(("\ufeff" + text.replace("\n", "\r\n")).encode())
    images = read_images(folder)
    np.testing.assert_array_equal(images.stamps, plain.stamps)
    np.testing.assert_array_equal(images.rig.T_left_right, plain.rig.T_left_right)
    assert images.notes == plain.notes
    if plain.motion is not None:
        np.testing.assert_array_equal(images.motion.twists, plain.motion.twists)


def test_a_table_may_name_its_columns_without_a_mark(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    for name in ("cam0", "cam1", "imu0"):
        edit(f"mav0/{name}/data.csv", "#timestamp", "timestamp")(folder)
    np.testing.assert_array_equal(read_images(folder).stamps, STAMPS)


def test_samples_in_any_order_are_the_same_motion(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    plain = read_images(folder).motion
    table = folder / "mav0" / "imu0" / "data.csv"
    title, *rows = table.read_text().splitlines()
    table.write_text("\n".join([title, rows[-1], *rows[:-1], rows[3]]))
    images = read_images(folder)
    np.testing.assert_array_equal(images.motion.stamps, plain.stamps)
    np.testing.assert_array_equal(images.motion.twists, plain.twists)
    assert images.notes == (
        "Left out 1 rows of imu0/data.csv that repeat a stamp.",
        "Put the rows of imu0/data.csv in order: 1 had a stamp before the last one's.",
    )


def test_kittis_samples_in_any_order_are_the_same_motion(tmp_path: Path) -> None:
    folder = write_kitti_raw(tmp_path / "0020_sync")
    plain = read_images(folder).motion
    oxts = folder / "oxts"
    first, *others = (oxts / "timestamps.txt").read_text().splitlines()
    (oxts / "timestamps.txt").write_text("\n".join([*others, first]))
    samples = sorted((oxts / "data").iterdir())
    texts = [sample.read_text() for sample in samples]
    for sample, text in zip(samples, [*texts[1:], texts[0]], strict=True):
        sample.write_text(text)
    images = read_images(folder)
    np.testing.assert_array_equal(images.motion.stamps, plain.stamps)
    np.testing.assert_array_equal(images.motion.twists, plain.twists)
    assert "Put the oxts samples in order: 1 had a time before the last one's." in images.notes


@pytest.mark.parametrize("period", [PERIOD // 1000, PERIOD * 1000])
def test_stamps_of_another_unit_are_no_times_of_images(period: int, tmp_path: Path) -> None:
    images = read_images(write_asl(tmp_path / "V1_01"))
    images.known_motion()
    stamped = replace(images, stamps=START + period * np.arange(FRAMES))
    with pytest.raises(VislamError, match="V1_01: unit of the stamps: a time between images of"):
        stamped.known_motion()


def test_motion_of_another_time_than_the_images_is_refused(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    table = folder / "mav0" / "imu0" / "data.csv"
    # Microseconds.
    table.write_text(re.sub(r"(?m)^(\d+)000,", r"\1,", table.read_text()))
    with pytest.raises(VislamError, match="both must tell the time by one clock, in nanoseconds"):
        read_images(folder).known_motion()


def test_frames_whose_images_are_missing_are_left_out(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01") / "mav0"
    (folder / "cam0" / "data" / f"{STAMPS[2]}.png").unlink()
    (folder / "cam1" / "data" / f"{STAMPS[5]}.png").unlink()
    images = read_images(folder)
    np.testing.assert_array_equal(images.stamps, np.delete(STAMPS, [2, 5]))
    assert sum(1 for _ in images.pairs()) == FRAMES - 2
    assert images.notes == (
        "1 images of cam0 are not there: their frames are left out.",
        "1 images of cam1 are not there: their frames are left out.",
        "Left out 2 images without one of the other camera at their stamp.",
    )


def test_a_folder_without_an_imu_has_no_motion_of_its_own(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    (folder / "mav0" / "imu0" / "data.csv").unlink()
    assert read_images(folder).motion is None
    assert read_images(folder, write_dataset(tmp_path / "motion.npz")).motion is not None


KITTI: dict[str, tuple[Fault, str]] = {
    "no calibration": (gone("calib.txt"), "06: has image_0 and no calib.txt: a pair needs all"),
    "one camera": (
        lambda folder: shutil.rmtree(folder / "image_1"),
        "06: has image_0 and no image_1: a pair needs all three",
    ),
    "no right camera": (edit("calib.txt", "P1:", "Q1:"), "has no P1: it has P0, Q1"),
    "few numbers": (edit("calib.txt", "P0: 100.0", "P0:"), "P0 holds 11 numbers, not 12"),
    "no number": (edit("calib.txt", "P1: 100.0", "P1: 1OO.0"), "P1: number 1 is no finite number"),
    "no finite number": (edit("calib.txt", "P1: 100.0", "P1: NaN"), "P1: number 1 is no finite"),
    "one place": (
        edit("calib.txt", "P1:", "P1: 100 0 9 0 0 100 9 0 0 0 1 0\nQ1:"),
        "calib.txt: P1 has the right camera 0 m to the right of that of P0",
    ),
    "no projection": (edit("calib.txt", "P0: 100.0 0.0", "P0: 100.0 3.0"), "P0 is no projection"),
    "no focal length": (edit("calib.txt", "P0: 100.0", "P0: 0.0"), "a focal length of 0 px"),
    "no time": (edit("times.txt", "2.000000e-01", "later"), "line 3 is 'later', no seconds"),
    "a blank line": (
        edit("times.txt", "3.000000e-01\n", "\n"),
        "times.txt: line 4 is blank, and each line is the time of a frame: write it, or take",
    ),
    "few times": (edit("times.txt", "7.000000e-01\n", ""), "has 7 times, none for image 7"),
    "time goes back": (
        edit("times.txt", "4.000000e-01", "1.000000e-01"),
        "line 5 is not later than that of the image before",
    ),
    "no pose": (
        edit("../poses/06.txt", "1 0 0", "1 0"),
        "poses/06.txt: line 1 is no pose of 12 finite numbers",
    ),
}


@pytest.mark.parametrize(("fault", "reason"), KITTI.values(), ids=KITTI)
def test_faults_of_kittis_odometry_are_named(fault: Fault, reason: str, tmp_path: Path) -> None:
    folder = write_kitti_odometry(tmp_path / "06")
    fault(folder)
    with pytest.raises(VislamError, match=re.escape(reason)) as caught:
        read_images(folder)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


RAW: dict[str, tuple[Fault, str]] = {
    "no calibration": (gone("../calib_velo_to_cam.txt"), "cannot read this calibration"),
    "one camera": (
        lambda folder: shutil.rmtree(folder / "image_01"),
        "0020_sync: has no image_01/data: both cameras are needed",
    ),
    "no rotation": (edit("../calib_imu_to_velo.txt", "R: 1", "R: 2"), "no rotation"),
    "no time": (
        edit("image_00/timestamps.txt", "2014-05", "May"),
        "image_00/timestamps.txt: line 1 is 'May-13",
    ),
    "few times": (
        lambda folder: (folder / "oxts" / "timestamps.txt").write_text(""),
        "oxts/timestamps.txt: has 0 times, none for 7.txt",
    ),
    "a blank line": (
        edit("image_01/timestamps.txt", "2014-05", "\n2014-05"),
        "image_01/timestamps.txt: line 1 is blank, and each line is the time of a frame",
    ),
    "no sample": (
        lambda folder: (folder / "oxts" / "data" / "0000000003.txt").write_text("1 2 3"),
        "0000000003.txt: holds no 20 finite numbers",
    ),
}


@pytest.mark.parametrize(("fault", "reason"), RAW.values(), ids=RAW)
def test_faults_of_kittis_recordings_are_named(fault: Fault, reason: str, tmp_path: Path) -> None:
    folder = write_kitti_raw(tmp_path / "0020_sync")
    fault(folder)
    with pytest.raises(VislamError, match=re.escape(reason)) as caught:
        read_images(folder)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("write", [write_kitti_odometry, write_kitti_raw])
def test_kittis_missing_images_leave_their_numbers_to_the_others(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    folder = write(tmp_path / "drive")
    left = next(each for each in folder.iterdir() if each.name.startswith("image_0"))
    next(each for each in left.rglob("*3.png")).unlink()
    images = read_images(folder, write_dataset(tmp_path / "motion.npz"))
    expected = np.delete(STAMPS, 3)
    np.testing.assert_allclose(images.stamps, expected, atol=200, rtol=0)
    assert "Left out 1 images without one of the other camera" in images.notes[0]


def test_images_without_times_have_those_of_the_motion(tmp_path: Path) -> None:
    folder = write_kitti_odometry(tmp_path / "06", times=False)
    (folder / "image_0" / "000003.png").unlink()
    images = read_images(folder, write_dataset(tmp_path / "motion.npz"))
    np.testing.assert_allclose(images.stamps, np.delete(STAMPS, 3), atol=200, rtol=0)


def test_a_motion_of_another_time_is_refused(tmp_path: Path) -> None:
    folder = write_asl(tmp_path / "V1_01")
    arrays = dict(np.load(write_dataset(tmp_path / "motion.npz")))
    arrays["time_stamps"] = arrays["time_stamps"][0, :1] + 0.31 * np.arange(FRAMES) + 500
    other = tmp_path / "other.npz"
    np.savez(other, **arrays)
    with pytest.raises(VislamError, match=r"other\.npz: none of its 8 frames is at the time of"):
        read_images(folder, other)


def test_what_holds_no_motion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VislamError, match="neither a dataset nor a bag: --motion takes one"):
        read_motion(tmp_path)
    with pytest.raises(VislamError, match="no such file or directory"):
        read_motion(tmp_path / "missing.npz")


def test_what_holds_no_images_is_told_what_does(tmp_path: Path) -> None:
    assert not is_images(tmp_path)
    with pytest.raises(VislamError, match="holds no images: give an EuRoC/ASL folder"):
        read_images(tmp_path)
    with pytest.raises(VislamError, match="no such file or directory"):
        read_images(tmp_path / "missing")
