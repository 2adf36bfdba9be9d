# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that were changed on the running slam_node, told with the step that takes them."""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy.impl.rcutils_logger import RcutilsLogger

from vislam_ros.core.settings import differences
from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")

#: By name, the value before and the one that holds now.
Changes = Mapping[str, tuple[Any, Any]]

_CHANGED = "changed"


class ParameterChanges:
    """Gathers changes until the next step.

    Parameters
    ----------
    logger : RcutilsLogger
        Of the node; each change is a line in its log.
    """

    def __init__(self, logger: RcutilsLogger):
        self._logger = logger
        self._gathered: dict[str, tuple[Any, Any]] = {}

    def note(self, before: S, after: S) -> None:
        """Note what differs between settings."""
        for name, (old, new) in differences(before, after).items():
            self._logger.info(f"{name}: {new!r} from the next step on, for {old!r}")
            first, _ = self._gathered.pop(name, (old, new))
            if first != new:
                self._gathered[name] = first, new

    def take(self) -> Changes:
        """Return what was noted since the last call."""
        gathered, self._gathered = self._gathered, {}
        return gathered


def change_values(changes: Changes) -> dict[str, object]:
    """Values of a status on ``slam/steps``: none where nothing was changed."""
    return {_CHANGED: json.dumps(changes)} if changes else {}


def changes_from_values(values: Mapping[str, str]) -> Changes:
    """Inverse of :func:`change_values`.

    Raises
    ------
    RefusedMessage
        ``bad_fields``, where it is not what that makes.
    """
    try:
        told = json.loads(values.get(_CHANGED, "{}"))
        return {str(name): (before, value) for name, (before, value) in told.items()}
    except (AttributeError, TypeError, ValueError, RecursionError) as error:
        raise RefusedMessage(Refusal.BAD_FIELDS, f"slam/steps: {_CHANGED}: {error!r}") from error
