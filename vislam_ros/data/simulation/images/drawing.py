# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A camera without a lens draws surfaces: each by its homography, the nearest in front."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.compiled import compiled
from vislam_ros.core.geometry import se3
from vislam_ros.data.simulation.images.surfaces import Layer, SurfaceStack
from vislam_ros.data.simulation.images.texture import Grey, Texture

Array = NDArray[np.float64]

_NEAR = 0.05  # metres before the camera where the view begins
# A piece of a surface has one sharpness of its texture: it goes from one depth to this many times.
_DEPTH_RATIO = 1.5
# A plane so near to the camera's centre is seen from its edge, metres.
_ON_EDGE = 1e-4
_FARTHEST = 1e-9  # inverse depth of a backdrop: beyond all else, 1/m


class Pinhole:
    """An ideal camera; world points are drawn where it projects them, to a fraction of a pixel.

    Pixels are drawn smaller than they are to be, so that a mean over them has smooth edges.

    Parameters
    ----------
    K : ndarray, (3, 3)
        Intrinsics, in pixels whose centres are whole numbers.
    image_size : tuple of int, (2,)
        Width and height, pixels.
    oversampling : float
        How many small pixels lie along a pixel's side.
    """

    def __init__(self, K: Array, image_size: tuple[int, int], oversampling: float = 2.0) -> None:
        self.oversampling = oversampling
        shift = (oversampling - 1) / 2
        small = np.array([[oversampling, 0, shift], [0, oversampling, shift], [0, 0, 1.0]])
        self._K = small @ K
        self._K_inverse = np.linalg.inv(self._K)
        self._size = (
            math.ceil(image_size[0] * oversampling),
            math.ceil(image_size[1] * oversampling),
        )
        width, height = self._size
        edges = self._K_inverse @ np.array(
            [[-1, width, width, -1], [-1, -1, height, height], [1.0] * 4]
        )
        # Inward normals of the planes through the centre and the image's borders.
        self._borders = np.cross(edges.T, np.roll(edges.T, -1, axis=0))

    def draw(self, T_world_camera: Array, surfaces: SurfaceStack, empty: int = 0) -> Grey:
        """Draw what the camera sees.

        Parameters
        ----------
        T_world_camera : ndarray, (4, 4)
        surfaces : SurfaceStack
        empty : int
            Grey where there is nothing.

        Returns
        -------
        ndarray of uint8, (oversampling * height, oversampling * width)
        """
        canvas = _Canvas(self._size, empty)
        T_camera_world = se3.inverse(T_world_camera)
        R, p = T_camera_world[:3, :3], T_camera_world[:3, 3]
        finite = (surfaces.layers != Layer.BACKDROP)[:, None] * p
        camera_from_texels = R @ surfaces.world_from_texels
        camera_from_texels[:, :, 2] += finite
        corners = surfaces.corners @ R.T + finite[:, None, :]

        normals = np.cross(camera_from_texels[:, :, 0], camera_from_texels[:, :, 1])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        distances = np.sum(normals * camera_from_texels[:, :, 2], axis=1)
        beyond = np.any(np.all(corners @ self._borders.T < 0, axis=1), axis=1)
        seen = (distances > _ON_EDGE) & ~beyond & np.any(corners[:, :, 2] > _NEAR, axis=1)
        (rows,) = np.nonzero(seen)
        # What is hidden by something nearer costs little if that is there already.
        layers = surfaces.layers[rows]
        near = np.where(layers == Layer.SOLID, corners[rows, :, 2].min(axis=1), 0.0)
        rows = rows[np.lexsort((near, layers))]
        if len(rows) == 0:
            return canvas.picture
        texels_from_pixels = np.linalg.inv(self._K @ camera_from_texels[rows])
        inverse_depths = normals[rows] @ self._K_inverse / distances[rows, None]
        inverse_depths[surfaces.layers[rows] == Layer.BACKDROP] = [0.0, 0.0, _FARTHEST]
        for i, H, plane in zip(rows.tolist(), texels_from_pixels, inverse_depths, strict=True):
            for piece in _pieces(corners[i]):
                pixels = piece @ self._K.T
                canvas.paint(
                    pixels[:, :2] / pixels[:, 2:],
                    surfaces.textures[i],
                    H,
                    shade=float(surfaces.shades[i]),
                    inverse_depth=plane,
                    over=bool(surfaces.layers[i] == Layer.FLOOR),
                )
        return canvas.picture


class _Canvas:
    """A picture under work, with the inverse depth of each of its pixels."""

    def __init__(self, size: tuple[int, int], empty: int) -> None:
        width, height = size
        self.picture: Grey = np.full((height, width), empty, dtype=np.uint8)
        self._inverse_depths = np.zeros((height, width), dtype=np.float32)

    def paint(
        self,
        polygon: Array,
        texture: Texture,
        texels_from_pixels: Array,
        *,
        shade: float,
        inverse_depth: Array,
        over: bool,
    ) -> None:
        """Paint a convex polygon (n, 2), pixels, where nothing is nearer, or over everything.

        Its inverse depth is ``inverse_depth @ (x, y, 1)``.
        """
        left, top, inside = _cover(polygon, inverse_depth, self._inverse_depths, over)
        height, width = inside.shape
        if not inside.size:
            return
        middle = np.clip(polygon.mean(axis=0), [left, top], [left + width, top + height])
        level = texture.nearest_level(*_footprint(texels_from_pixels, middle))
        u, v = 0.5 ** level[0], 0.5 ** level[1]
        # A texel's centre has a whole index, and lies half a texel from its border.
        index_from_texels = np.array([[u, 0, -0.5], [0, v, -0.5], [0, 0, 1]])
        from_window = np.array([[1.0, 0, left], [0, 1, top], [0, 0, 1]])
        piece = cv2.warpPerspective(
            texture.level(level),
            index_from_texels @ texels_from_pixels @ from_window,
            (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_WRAP,
        )
        if shade != 1.0:
            piece = cv2.convertScaleAbs(piece, alpha=shade)
        window = self.picture[top : top + height, left : left + width]
        np.copyto(window, piece, where=inside)


def _footprint(texels_from_pixels: Array, pixel: Array) -> tuple[float, float]:
    """Texels, along u and along v, that a small pixel's width or height covers."""
    u, v, w = texels_from_pixels @ [*pixel, 1.0]
    (ux, uy, _), (vx, vy, _), (wx, wy, _) = texels_from_pixels
    du = math.hypot(ux - u / w * wx, uy - u / w * wy) / abs(w)
    dv = math.hypot(vx - v / w * wx, vy - v / w * wy) / abs(w)
    return du, dv


def _pieces(corners: Array) -> list[Array]:
    """Cut a convex polygon (n, 3), camera axes, into ranges of depth, without what is too near."""
    nearest, farthest = max(float(corners[:, 2].min()), _NEAR), float(corners[:, 2].max())
    first = math.ceil(math.log(nearest / _NEAR, _DEPTH_RATIO))
    last = math.ceil(math.log(farthest / _NEAR, _DEPTH_RATIO))
    cuts = [_NEAR * _DEPTH_RATIO**k for k in range(first, last)]
    pieces = []
    rest = corners
    for depth in cuts:
        near, rest = _cut(rest, depth)
        if depth > _NEAR:
            pieces.append(near)
    return [piece for piece in (*pieces, rest) if len(piece) > 2]


def _cut(polygon: Array, depth: float) -> tuple[Array, Array]:
    """Both parts of a convex polygon (n, 3), nearer than a depth and farther."""
    near: list[Array] = []
    far: list[Array] = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        (far if a[2] >= depth else near).append(a)
        if (a[2] >= depth) != (b[2] >= depth):
            between = a + (depth - a[2]) / (b[2] - a[2]) * (b - a)
            near.append(between)
            far.append(between)
    return np.array(near), np.array(far)


@compiled(
    "Tuple((int64, int64, boolean[:, :]))(float64[:, ::1], float64[::1], float32[:, ::1], boolean)"
)
def _cover(
    polygon: Array, plane: Array, depths: NDArray[np.float32], over: bool
) -> tuple[int, int, NDArray[np.bool_]]:
    """Pixels that a convex polygon covers, and their new inverse depths.

    Pixels whose centres lie on a border belong to one of the two polygons that share it.

    Returns
    -------
    left, top : int
        First column and row of the mask.
    inside : ndarray of bool, (h, w)
        Empty where nothing of the polygon is seen.
    """
    rows, columns = depths.shape
    top = min(max(math.ceil(polygon[:, 1].min()), 0), rows)
    bottom = max(min(math.ceil(polygon[:, 1].max()), rows), top)
    begins, ends = np.full(bottom - top, np.inf), np.full(bottom - top, -np.inf)
    for k in range(len(polygon)):
        x0, y0 = polygon[k - 1]
        x1, y1 = polygon[k]
        if y1 < y0 or (y1 == y0 and x1 < x0):  # both sides of a border get the same numbers
            x0, y0, x1, y1 = x1, y1, x0, y0
        for y in range(max(math.ceil(y0), top), min(math.ceil(y1), bottom)):
            x = x0 + (y - y0) * ((x1 - x0) / (y1 - y0))
            begins[y - top] = min(begins[y - top], x)
            ends[y - top] = max(ends[y - top], x)

    first = min(max(math.floor(polygon[:, 0].min()), 0), columns)
    last = max(min(math.ceil(polygon[:, 0].max()), columns), first)
    inside = np.zeros((bottom - top, last - first), dtype=np.bool_)
    left, right, upper, lower = last, first, bottom, top  # of what is seen
    for y in range(top, bottom):
        begin, end = max(np.ceil(begins[y - top]), first), min(np.ceil(ends[y - top]), last)
        for x in range(int(begin), int(end)):
            depth = np.float32(plane[0] * x + plane[1] * y + plane[2])
            if over or depth > depths[y, x]:
                inside[y - top, x - first] = True
                left, right = min(left, x), max(right, x + 1)
                upper, lower = min(upper, y), y + 1
                depths[y, x] = depth
    seen = inside[upper - top : max(lower, upper) - top, left - first : max(right, left) - first]
    return left, upper, seen
