# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings by name, those of all estimators beside each other, as a parameter file has them.

The estimator that is named among them takes what is its; what belongs to others changes nothing,
and is told where it is not their default.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from vislam_ros.core.filters.registry import Registration, estimator_named, estimator_names
from vislam_ros.core.settings import SlamSettings, nearest_name, settings_from_dict
from vislam_ros.errors import SettingsError


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
        Where they are another estimator's, or none.
    """
    if not isinstance(settings, SlamSettings):
        raise SettingsError(
            f"settings are of type {type(settings).__name__}: give SlamSettings or an estimator's "
            'own, or each by name, as estimator="joint"'
        )
    wanted = estimator_named(settings.estimator).settings
    if isinstance(settings, wanted):
        return settings
    if type(settings) is SlamSettings:
        return wanted(**dataclasses.asdict(settings))
    raise SettingsError(
        f"estimator: {settings.estimator!r} has {wanted.__name__}, not {type(settings).__name__}"
    )


def _chosen(values: Mapping[str, Any]) -> Registration:
    return estimator_named(str(values.get("estimator", SlamSettings.estimator)))


def _own(registration: Registration, values: Mapping[str, Any]) -> SlamSettings:
    """Settings of an estimator, of those values that are its."""
    names = registration.setting_names
    own = {name: value for name, value in values.items() if name in names}
    return settings_from_dict(registration.settings, own)
