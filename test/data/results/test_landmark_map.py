# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from vislam_ros.core.landmarks import LandmarkMap
from vislam_ros.data.results.landmark_map import read_landmarks, write_landmarks, write_point_cloud
from vislam_ros.errors import VislamError


def random_map(points: int) -> LandmarkMap:
    rng = np.random.default_rng(2)
    A = rng.normal(size=(points, 3, 3))
    return LandmarkMap(
        ids=rng.integers(0, 2**32, points, dtype=np.uint32),
        generations=rng.integers(0, 5, points, dtype=np.uint32),
        positions=rng.normal(scale=100.0, size=(points, 3)),
        covariances=A @ np.swapaxes(A, 1, 2),
    )


@pytest.mark.parametrize("points", [0, 1, 50])
def test_a_map_reads_back_to_the_last_bit(tmp_path: Path, points: int) -> None:
    landmarks = random_map(points)
    write_landmarks(tmp_path / "landmarks.npz", landmarks)
    back = read_landmarks(tmp_path / "landmarks.npz")
    for name in ("ids", "generations", "positions", "covariances"):
        np.testing.assert_array_equal(getattr(back, name), getattr(landmarks, name))
        assert getattr(back, name).dtype == getattr(landmarks, name).dtype


def test_equal_maps_are_equal_files(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        write_landmarks(tmp_path / name, random_map(10))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"covariances": None}, "has no array 'covariances'"),
        ({"ids": None}, "has no array 'ids'"),
        ({"positions": np.zeros((4, 3))}, r"positions is float64 \(4, 3\).*float64 \(5, 3\)"),
        ({"ids": np.zeros((5, 1), np.uint32)}, r"ids is uint32 \(5, 1\)"),
        ({"generations": np.zeros(5)}, "generations is float64"),
        ({"positions": np.full((5, 3), np.nan)}, "positions holds a number that is not finite"),
        ({"ids": np.array(["a"] * 5, dtype=object)}, "ids: holds an array of objects"),
    ],
)
def test_a_map_that_lacks_something_is_refused(
    tmp_path: Path, changes: dict[str, np.ndarray | None], message: str
) -> None:
    arrays = {**vars(random_map(5)), **changes}
    path = tmp_path / "landmarks.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(VislamError, match=message):
        read_landmarks(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"plain text"])
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "landmarks.npz"
    path.write_bytes(content)
    with pytest.raises(VislamError, match=r"is neither an \.npz|is cut off or damaged"):
        read_landmarks(path)


def test_a_flipped_byte_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "landmarks.npz"
    write_landmarks(path, random_map(50))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(VislamError, match="is cut off or damaged"):
        read_landmarks(path)


def test_a_single_array_or_a_missing_file_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "array.npy", np.zeros(3))
    with pytest.raises(VislamError, match="holds no dict of arrays"):
        read_landmarks(tmp_path / "array.npy")
    with pytest.raises(VislamError, match="cannot read these landmarks: No such file"):
        read_landmarks(tmp_path / "none.npz")


def test_the_point_cloud_is_binary_ply(tmp_path: Path) -> None:
    landmarks = random_map(7)
    write_point_cloud(tmp_path / "landmarks.ply", landmarks)
    header, _, body = (tmp_path / "landmarks.ply").read_bytes().partition(b"end_header\n")
    assert header.decode().splitlines() == [
        "ply",
        "format binary_little_endian 1.0",
        "element vertex 7",
        "property float x",
        "property float y",
        "property float z",
        "property uint id",
    ]
    words = np.frombuffer(body, dtype="<u4").reshape(7, 4)
    np.testing.assert_array_equal(words[:, 3], landmarks.ids)
    np.testing.assert_array_equal(
        words[:, :3].copy().view("<f4"), landmarks.positions.astype(np.float32)
    )
