# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The estimators by name, with the settings of each and how a session makes it.

An estimator is one file: its settings, its class, and at the end a call of
:func:`register_estimator`. One of this package is imported when somebody asks for it, one from
outside when it is named as ``module:Class``.
"""

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from vislam_ros.core.filters.settings import GivenMapSettings
from vislam_ros.core.settings import SlamSettings, nearest_name, settings_from_dict
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


def slam_settings(values: Mapping[str, Any]) -> SlamSettings:
    """Build the settings of the estimator that values by name choose, checked.

    Values of other estimators' settings may be among them; they must be valid, too.

    Raises
    ------
    SettingsError
        Naming the setting, the value and what is allowed.
    """
    owners = setting_owners(values)
    for name in values:
        if name not in owners:
            raise SettingsError(f"{name}: no such parameter{nearest_name(name, owners)}")
    for name in {owners[name].name for name in values}:
        _own(estimator_named(name), values)
    return _own(_chosen(values), values)


def replaced(settings: SlamSettings, **values: Any) -> SlamSettings:
    """Put values by name over settings; another estimator takes of these what it has."""
    return slam_settings({**dataclasses.asdict(settings), **values})


def unused_settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values, by name, that are other than their default and that the estimator ignores."""
    chosen, owners = _chosen(values), setting_owners(values)
    used = chosen.setting_names - set(chosen.unused)
    unused = {}
    for name in sorted(values.keys() & owners.keys() - used):
        value = getattr(_own(owners[name], values), name)
        if value != getattr(owners[name].settings(), name):
            unused[name] = value
    return unused


def unused_note(values: Mapping[str, Any]) -> str | None:
    """One line about settings that change nothing; None where there are none."""
    unused = unused_settings(values)
    if not unused:
        return None
    return f"{', '.join(unused)}: set, but not used by estimator {_chosen(values).name}"


def setting_owners(values: Mapping[str, Any]) -> dict[str, Registration]:
    """Find an estimator for each known setting that has it: the chosen one where that does."""
    everyone = [*(estimator_named(name) for name in reversed(estimator_names())), _chosen(values)]
    return {name: each for each in everyone for name in each.setting_names}


def completed(settings: SlamSettings) -> SlamSettings:
    """Settings of every session, with those of the chosen estimator's own at their defaults.

    Raises
    ------
    SettingsError
        Where they are another estimator's.
    """
    wanted = estimator_named(settings.estimator).settings
    if isinstance(settings, wanted):
        return settings
    if type(settings) is SlamSettings:
        return wanted(**dataclasses.asdict(settings))
    raise SettingsError(
        f"estimator: {settings.estimator!r} has {wanted.__name__}, not {type(settings).__name__}"
    )


def _chosen(values: Mapping[str, Any]) -> Registration:
    return estimator_named(values.get("estimator", SlamSettings.estimator))


def _own(registration: Registration, values: Mapping[str, Any]) -> SlamSettings:
    """Settings of an estimator, of those values that are its."""
    names = registration.setting_names
    own = {name: value for name, value in values.items() if name in names}
    return settings_from_dict(registration.settings, own)
