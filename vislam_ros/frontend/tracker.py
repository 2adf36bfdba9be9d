# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Points followed through rectified stereo images.

A point is begun where the left image has a corner whose partner in the right one is certain. From
image to image it is followed by pyramidal Lucas and Kanade, forward and back, with the camera's
motion as first guess; then its place is refined against the patch where it was begun, laid over
by the map that the motion and the surface's tilt give. So errors do not add up along a track:
only where the view has changed so much that the patch no longer serves, a new one is cut. The
place in the right image is that of the left image's patch of now, with the surface's tilt.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vislam_ros.core.geometry.camera import StereoCamera
from vislam_ros.errors import VislamError
from vislam_ros.frontend.camera_motion import camera_motion, moved
from vislam_ros.frontend.detection import new_corners
from vislam_ros.frontend.flow import follow
from vislam_ros.frontend.patches import Places, cut_patches, fits, place
from vislam_ros.frontend.points import Points
from vislam_ros.frontend.repeated import is_repeated
from vislam_ros.frontend.row_search import row_search
from vislam_ros.frontend.settings import TrackerSettings
from vislam_ros.frontend.stated_noise import stated_noise

Grey = NDArray[np.uint8]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

# A search to whole pixels ends so near to the place [px].
_SEARCHED = 2.0
_MOST_IDS = 2**32


@dataclass(frozen=True)
class Tracked:
    """What a stereo pair shows.

    Attributes
    ----------
    ids : ndarray of uint32, (n,)
        Increasing; an id stands for one point. When all 2^32 are used up, after days, those of
        points that are long gone are given again, from 0 on.
    pixels : ndarray of float32, (n, 4)
        ``u_left, v_left, u_right, v_right`` in the rectified images.
    noise : ndarray of float32, (n,)
        Standard deviation of each of the four, pixels.
    repeated : bool
        Whether the images are those of before over again: then there is nothing new to see, and
        no observation. Points are followed on from the next images.
    """

    ids: NDArray[np.uint32]
    pixels: Floats
    noise: Floats
    repeated: bool = False


def _nothing(*, repeated: bool = False) -> Tracked:
    none = np.empty(0, np.float32)
    return Tracked(np.empty(0, np.uint32), np.empty((0, 4), np.float32), none, repeated)


class StereoTracker:
    """Follows points from one rectified stereo pair to the next.

    Parameters
    ----------
    camera : StereoCamera
        Of the rectified images.
    image_size : tuple of int, (2,)
        Width and height, pixels.
    settings : TrackerSettings
    """

    def __init__(
        self,
        camera: StereoCamera,
        image_size: tuple[int, int],
        settings: TrackerSettings | None = None,
    ):
        self._camera = camera
        self._size = image_size
        self.change_settings(settings or TrackerSettings())
        self._points = Points.none()
        self._before: tuple[Grey, Grey] | None = None
        self._next_id = 0
        # Of the last image in which a motion was found; and the rotation since the last image.
        self._motion = np.eye(4)
        self._turned: NDArray[np.float64] | None = np.eye(3)

    @property
    def settings(self) -> TrackerSettings:
        """Settings that are in use."""
        return self._settings

    def change_settings(self, settings: TrackerSettings) -> None:
        """Take other settings from the next pair on."""
        self._settings = settings
        self._largest = settings.largest_disparity or self._size[0] // 4

    def track(
        self, left: Grey, right: Grey, R_now_before: NDArray[np.float64] | None = None
    ) -> Tracked:
        """Take the next pair.

        Parameters
        ----------
        left, right : ndarray of uint8, (H, W)
        R_now_before : ndarray, (3, 3), optional
            Rotation that takes coordinates of the left camera at the last pair to those of now,
            as a gyroscope tells it. Without, the last motion is expected to go on.

        Returns
        -------
        Tracked

        Raises
        ------
        VislamError
            If an image is not (H, W) of uint8 and of the camera's size.
        """
        left, right = self._checked("left", left), self._checked("right", right)
        if self._turned is not None:
            self._turned = None if R_now_before is None else R_now_before @ self._turned
        if self._before is not None:
            copied = [is_repeated(*pair) for pair in zip((left, right), self._before, strict=True)]
            if any(copied):
                # One of them alone is as old as the other is new: no stereo pair.
                return _nothing(repeated=True)
        points = self._points
        covariance = np.zeros((0, 3), np.float32)
        if self._before is not None and len(points):
            points, covariance = self._followed(points, self._before[0], left)
        seen, there = self._matched(points, left, right, self._settings.off_the_motion)
        points, covariance = points[seen], covariance[seen]
        new = self._begun(points, left, right)
        seen, there_new = self._matched(new, left, right, _SEARCHED)
        new = new[seen]
        new.ids[:] = self._new_ids(len(new), points.ids)
        points = points.with_new(new)
        matches = np.concatenate([there.points, there_new.points])
        points.disparities = points.left[:, 0] - matches[:, 0]
        points.slopes = np.concatenate([there.slopes, there_new.slopes])
        self._points, self._before, self._turned = points, (left, right), np.eye(3)
        of_right = np.concatenate([there.covariance, there_new.covariance])
        of_left = np.concatenate([covariance, there_new.covariance])
        noise = stated_noise(of_left, of_right, points.drift)
        rows = np.argsort(points.ids)  # as they are, but where ids have begun again
        pixels = np.concatenate([points.left, matches], axis=1)
        return Tracked(points.ids[rows], pixels[rows], noise[rows])

    def _new_ids(self, count: int, taken: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Ids (count,) for new points, none of them among those that are taken (n,)."""
        ids = (self._next_id + np.arange(count + len(taken), dtype=np.int64)) % _MOST_IDS
        ids = ids[~np.isin(ids, taken)][:count]
        if count:
            self._next_id = (int(ids[-1]) + 1) % _MOST_IDS
        return ids

    def _checked(self, name: str, image: Grey) -> Grey:
        width, height = self._size
        if image.shape != (height, width) or image.dtype != np.uint8:
            raise VislamError(
                f"{name} image: is {image.shape} of {image.dtype}, not ({height}, {width}) of "
                "uint8: give the rectified grey image of the camera's size"
            )
        # What comes from a message may be read-only, which compiled loops do not take.
        return np.require(image, np.uint8, ["C", "W"])

    def _followed(self, points: Points, before: Grey, left: Grey) -> tuple[Points, Floats]:
        """Points that are in the left image still, and the covariances (n, 3) of their places."""
        camera, settings = self._camera, self._settings
        expected = self._motion.copy()
        if self._turned is not None:
            expected[:3, :3] = self._turned
        y = points.image_points
        guess, _, ahead = moved(camera, y, points.slopes, expected)
        guess[~ahead] = y[~ahead]
        there, found = follow(
            before, left, points.left, guess[:, [0, 2]].astype(np.float32), settings.round_trip
        )
        motion = camera_motion(camera, y[found], there[found], settings.off_the_motion)
        if motion is None:
            warped, maps, good = moved(camera, y, points.slopes, expected)
            good &= found
        else:
            warped, maps, good = moved(camera, y, points.slopes, motion)
            expected_there = warped[:, [0, 2]].astype(np.float32)
            # What was lost, as near points are that grow fast, is looked for where it must be.
            there = np.where(found[:, None], there, expected_there)
            good &= np.linalg.norm(expected_there - there, axis=1) <= settings.off_the_motion
            points.disparities = (warped[:, 0] - warped[:, 1]).astype(np.float32)
        self._motion = np.eye(4) if motion is None else motion
        to_before = np.linalg.inv(maps[good]).astype(np.float64)
        return self._refined(points[good], before, left, there[good], to_before)

    def _refined(
        self,
        points: Points,
        before: Grey,
        left: Grey,
        there: Floats,
        to_before: NDArray[np.float64],
    ) -> tuple[Points, Floats]:
        """Places by the patches where the points began, or by the last image where these fail."""
        was = points.left
        points.maps = np.asarray(points.maps @ to_before, dtype=float)
        places = place(points.patches, points.maps, left, there)
        good = self._agree(places, there)
        points.left = np.where(good[:, None], places.points, there)
        covariance = np.where(good[:, None], places.covariance, np.float32(0))
        (rest,) = np.nonzero(~good)
        if len(rest):
            again = place(cut_patches(before, was[rest]), to_before[rest], left, there[rest])
            better = self._agree(again, there[rest])
            points.left[rest], covariance[rest] = again.points, again.covariance
            good[rest] = better
        spent = ~fits(points.maps)
        spent[rest] = True
        points.cut_anew(spent, left, (covariance[:, 0] + covariance[:, 2]) / 2)
        return points[good], covariance[good]

    def _agree(self, places: Places, there: Floats) -> Flags:
        near = np.linalg.norm(places.points - there, axis=1) <= self._settings.round_trip
        return near & (places.correlation >= self._settings.smallest_correlation)

    def _begun(self, points: Points, left: Grey, right: Grey) -> Points:
        """New points, with whole disparities, and ids that are still to be given."""
        wanted = self._settings.max_features - len(points)
        # Half of the corners have no certain partner.
        corners = new_corners(left, points.left, 2 * wanted, self._settings.max_features)
        disparities, _ = row_search(left, right, corners, self._largest)
        (rows,) = np.nonzero(np.isfinite(disparities))
        rows = rows[:wanted]
        ids = np.zeros(len(rows), np.uint32)
        return Points.begun(ids, left, corners[rows], disparities[rows])

    def _matched(
        self, points: Points, left: Grey, right: Grey, tolerance: float
    ) -> tuple[Flags, Places]:
        """Which points (n,) the right image shows, and the places of these (m,) there."""
        settings = self._settings
        expected = points.left.copy()
        expected[:, 0] -= points.disparities
        same = np.tile(np.eye(2), (len(points), 1, 1))
        there = place(cut_patches(left, points.left), same, right, expected, points.slopes)
        same[:, 0, 0] += there.slopes[:, 0]
        same[:, 0, 1] = there.slopes[:, 1]
        back = place(cut_patches(right, there.points), same, left, points.left)
        seen = (
            (there.correlation >= settings.smallest_correlation)
            & (back.correlation >= settings.smallest_correlation)
            & (np.linalg.norm(back.points - points.left, axis=1) <= settings.round_trip)
            & (np.abs(there.points[:, 1] - points.left[:, 1]) <= settings.row_difference)
            & (np.abs(there.points[:, 0] - expected[:, 0]) <= tolerance)
        )
        kept = Places(
            there.points[seen],
            there.covariance[seen],
            there.correlation[seen],
            there.slopes[seen],
        )
        return seen, kept
