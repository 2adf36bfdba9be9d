# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stereo features in a PointCloud2, of whatever field order, read and laid out as arrays.

Works on the message classes of rclpy and of rosbags alike: only attributes are used.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage

PIXEL_FIELDS = ("u_left", "v_left", "u_right", "v_right")

FEATURE_DTYPE = np.dtype([("id", "<u4"), *((name, "<f4") for name in PIXEL_FIELDS)])
"""A point of the features that this package writes: 20 bytes, little endian."""

UINT32, FLOAT32 = 6, 7

FEATURE_FIELDS = (
    ("id", 0, UINT32),
    *((name, 4 * (place + 1), FLOAT32) for place, name in enumerate(PIXEL_FIELDS)),
)
"""Name, offset and PointField datatype of each field of :data:`FEATURE_DTYPE`."""

NOISE_FIELD = "noise"

NOISY_FEATURE_DTYPE = np.dtype([*FEATURE_DTYPE.descr, (NOISE_FIELD, "<f4")])
"""A point whose source states its noise: 24 bytes."""

NOISY_FEATURE_FIELDS = (*FEATURE_FIELDS, (NOISE_FIELD, FEATURE_DTYPE.itemsize, FLOAT32))
"""As :data:`FEATURE_FIELDS`, of :data:`NOISY_FEATURE_DTYPE`."""

# PointField.INT8 = 1 to FLOAT64 = 8.
_NUMPY_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", UINT32: "u4", FLOAT32: "f4", 8: "f8"}

_LARGEST_POINT = 2**16  # bytes; numpy itself has none of 2 GiB


def pack_features(
    ids: NDArray[np.uint32],
    pixels: NDArray[np.float32],
    noise: NDArray[np.float32] | None = None,
) -> NDArray[np.uint8]:
    """Bytes (20 n,) of a features cloud, (24 n,) with noise.

    Parameters
    ----------
    ids : ndarray of uint32, (n,)
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right``.
    noise : ndarray of float32, (n,), optional
        Standard deviations, pixels.
    """
    points = np.empty(len(ids), dtype=FEATURE_DTYPE if noise is None else NOISY_FEATURE_DTYPE)
    if noise is not None:
        points[NOISE_FIELD] = noise
    points["id"] = ids
    for column, name in enumerate(PIXEL_FIELDS):
        points[name] = pixels[:, column]
    return points.view(np.uint8)


def unpack_features(
    cloud: Any,
) -> tuple[NDArray[np.uint32], NDArray[np.float32], NDArray[np.float32] | None]:
    """Ids (n,), pixels (n, 4) and noise (n,) of a features cloud, in the order of its points.

    The noise is None where the cloud has no such field.

    Parameters
    ----------
    cloud : PointCloud2
        Of any field order, offsets, byte order and further fields.

    Raises
    ------
    RefusedMessage
        Where a field is missing, of a type that cannot hold it, or has such a value, or where
        the data have another length than the message says.
    """
    width, height = int(cloud.width), int(cloud.height)
    step, row_step = int(cloud.point_step), int(cloud.row_step)
    dtype = _point_dtype(cloud.fields, step, ">" if cloud.is_bigendian else "<")
    data = np.frombuffer(cloud.data, dtype=np.uint8)
    if height == 1:
        row_step = width * step  # some writers leave it zero
    if row_step < width * step or len(data) != height * row_step:
        raise RefusedMessage(
            Refusal.WRONG_SIZE, "data has another length than height, width and steps say"
        )
    rows = data.reshape(height, row_step)[:, : width * step]
    points = np.ascontiguousarray(rows).reshape(-1).view(dtype)
    ids = points["id"].astype(np.int64)
    if np.any((ids < 0) | (ids > np.iinfo(np.uint32).max)):
        raise RefusedMessage(Refusal.BAD_FIELDS, "an id does not fit into 32 bits without a sign")
    pixels = np.stack([points[name] for name in PIXEL_FIELDS], axis=1)
    noise = None
    if NOISE_FIELD in (dtype.names or ()):
        noise = points[NOISE_FIELD].astype(np.float32)
        if not np.all(np.isfinite(noise) & (noise > 0.0)):
            raise RefusedMessage(
                Refusal.BAD_FIELDS,
                f"PointCloud2 field {NOISE_FIELD!r} is not finite and above 0: it is a standard "
                "deviation in pixels",
            )
    return ids.astype(np.uint32), pixels.astype(np.float32), noise


def _point_dtype(fields: Iterable[Any], point_step: int, byte_order: str) -> np.dtype[Any]:
    """Structured type of one point, of the five needed fields and of the noise, if it is there."""
    present = {field.name: field for field in fields}
    names = ["id", *PIXEL_FIELDS, *([NOISE_FIELD] if NOISE_FIELD in present else [])]
    formats, offsets = [], []
    for name in names:
        if name not in present:
            raise RefusedMessage(
                Refusal.BAD_FIELDS,
                f"PointCloud2 has no field {name!r}, only {', '.join(present) or 'none'}: "
                "features need id, u_left, v_left, u_right, v_right",
            )
        field = present[name]
        code = _NUMPY_TYPES.get(int(field.datatype), "?")
        if code[0] not in ("iu" if name == "id" else "f") or int(field.count) > 1:
            wanted = "a whole number (UINT32)" if name == "id" else "FLOAT32 or FLOAT64"
            raise RefusedMessage(
                Refusal.BAD_FIELDS,
                f"PointCloud2 field {name!r} has datatype {field.datatype} and count "
                f"{field.count}: it must be one value of {wanted}",
            )
        formats.append(byte_order + code)
        offsets.append(int(field.offset))
    ends = [
        offset + np.dtype(kind).itemsize for offset, kind in zip(offsets, formats, strict=True)
    ]
    if max(ends) > point_step:
        raise RefusedMessage(Refusal.WRONG_SIZE, "a field reaches beyond the point")
    if point_step > _LARGEST_POINT:
        raise RefusedMessage(Refusal.WRONG_SIZE, f"a point of {point_step} bytes")
    return np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": offsets,
            "itemsize": point_step,
        }
    )
