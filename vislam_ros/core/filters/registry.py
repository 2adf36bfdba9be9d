# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimators by name, each with the class of its settings and how a session makes it.

An estimator is one file: its settings, its class, and at the end a call of
:func:`register_estimator`. One of this package is imported when somebody asks for it, one from
outside when it is named as ``module:Class``.
"""

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from vislam_ros.core.filters.settings import GivenMapSettings
from vislam_ros.core.settings import SlamSettings
from vislam_ros.errors import SettingsError, VislamError
from vislam_ros.outside import import_outside, in_a_line

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vislam_ros.core.filters.estimator import Estimator
    from vislam_ros.core.geometry.camera import StereoCamera
    from vislam_ros.core.landmarks import LandmarkMap
    from vislam_ros.core.operations.error_state import Recorder

# Where this package's own estimators are, so that their names are known without an import.
_MODULES = {
    name: f"{__package__}.{name}"
    for name in (
        "robocentric",
        "joint",
        "block_diagonal",
        "mapping",
        "localization",
        "dead_reckoning",
    )
}

# Of an Estimator, see vislam_ros.core.filters.estimator.
_PARTS = (
    "T_world_body",
    "pose_covariance",
    "active",
    "landmark_count",
    "step",
    "landmarks",
)


@dataclass(frozen=True)
class Surroundings:
    """What a session gives the estimator that it makes.

    Attributes
    ----------
    camera : StereoCamera
    tape : Recorder or None
        Where to record for the backward pass; None where nothing is to be smoothed.
    given_map : LandmarkMap or None
        The map to localize in, for an estimator that needs one.
    ids_of_keys : callable
        Gives the track ids (n,) of keys (n,).
    """

    camera: "StereoCamera"
    tape: "Recorder | None"
    given_map: "LandmarkMap | None"
    ids_of_keys: "Callable[[NDArray[np.int64]], NDArray[np.uint32]]"


@dataclass(frozen=True)
class Registration:
    """What is known of an estimator, see :func:`register_estimator`."""

    name: str
    settings: type[SlamSettings]
    make: "Callable[[Any, Surroundings], Estimator]"
    smoothable: bool
    unused: tuple[str, ...]

    @property
    def needs_map(self) -> bool:
        """Whether it works on a given map."""
        return issubclass(self.settings, GivenMapSettings)

    def made(self, settings: SlamSettings, given: Surroundings) -> "Estimator":
        """Make the estimator.

        Raises
        ------
        SettingsError
            Where that fails, or what is made lacks a part of an estimator.
        """
        try:
            estimator = self.make(settings, given)
        except TypeError as error:
            raise SettingsError(
                f"estimator: {self.name!r} cannot be made: {in_a_line(error)}"
            ) from error
        lacking = [name for name in _PARTS if not hasattr(estimator, name)]
        if lacking:
            raise SettingsError(f"estimator: {self.name!r} has no {', '.join(lacking)}")
        return estimator

    def require_smoothable(self) -> None:
        """Raise a SettingsError where it cannot be smoothed."""
        if not self.smoothable:
            others = [name for name in estimator_names() if estimator_named(name).smoothable]
            raise SettingsError(
                f"estimator: {self.name!r} cannot be smoothed; use {' or '.join(others)}"
            )

    @property
    def setting_names(self) -> frozenset[str]:
        """Names of the settings that it has, used or not."""
        return frozenset(field.name for field in dataclasses.fields(self.settings))


S = TypeVar("S", bound=SlamSettings)

_registered: dict[str, Registration] = {}


def register_estimator(
    name: str,
    settings: type[S],
    make: "Callable[[S, Surroundings], Estimator]",
    *,
    smoothable: bool = False,
    unused: tuple[str, ...] = (),
) -> None:
    """Make an estimator known under a name.

    Parameters
    ----------
    name : str
        Value of the setting ``estimator`` that chooses it.
    settings : type
        Frozen dataclass that extends :class:`~vislam_ros.core.settings.SlamSettings` by what is
        the estimator's own, each field with a default.
    make : callable
        Makes the :class:`~vislam_ros.core.filters.estimator.Estimator` of settings and
        :class:`Surroundings`; its class, if that takes the two.
    smoothable : bool, optional
        Whether it records its operations on the tape that it is given, and so can be smoothed.
    unused : tuple of str, optional
        Names of settings of every session that do not matter to it.

    Raises
    ------
    SettingsError
        Where an estimator of this package has that name, or the settings are no such class.
    """
    if not (isinstance(settings, type) and issubclass(settings, SlamSettings)):
        raise SettingsError(f"{name}: its settings {settings!r} are no subclass of SlamSettings")
    try:
        settings()
    except TypeError as error:
        raise SettingsError(f"{name}: each of its settings needs a default: {error}") from error
    if name in _MODULES and getattr(make, "__module__", None) != _MODULES[name]:
        raise SettingsError(f"{name}: is the name of an estimator of this package: take another")
    _registered[name] = Registration(name, settings, make, smoothable, unused)


def estimator_names() -> tuple[str, ...]:
    """Names that can be chosen; without those of ``module:Class``."""
    return (*_MODULES, *(name for name in _registered if name not in _MODULES))


def estimator_named(name: str) -> Registration:
    """Find an estimator by its name or as ``module:Class``.

    Raises
    ------
    SettingsError
        Where there is none, or it cannot be imported.
    """
    module, colon, attribute = str(name).partition(":")
    if colon:
        return _outside(name, module, attribute)
    if name in _MODULES and name not in _registered:
        importlib.import_module(_MODULES[name])
    if name not in _registered:
        raise SettingsError(
            f"estimator: {name!r} is none of {', '.join(estimator_names())}, nor module:Class of "
            "your own"
        )
    return _registered[name]


def _outside(name: str, module: str, attribute: str) -> Registration:
    """Import the estimator ``module:Class``, which registers itself."""
    try:
        made = getattr(import_outside(module), attribute)
    except (VislamError, AttributeError) as error:
        raise SettingsError(f"estimator: {name!r}: {error}") from error
    for registration in _registered.values():
        if registration.make is made:
            return registration
    raise SettingsError(
        f"estimator: {name!r} is not registered: call register_estimator in {module}"
    )
