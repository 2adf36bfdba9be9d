# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameters declared from a settings dataclass, with meaning, range and one-line errors."""

import dataclasses
import sys
from array import array
from collections.abc import Callable, Container
from typing import TYPE_CHECKING, Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from vislam_ros.core.filters.flat_settings import setting_owners, slam_settings, unused_note
from vislam_ros.core.settings import (
    SlamSettings,
    is_live,
    nearest_name,
    settings_from_dict,
)
from vislam_ros.errors import SettingsError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

S = TypeVar("S", bound="DataclassInstance")


def declare_settings(
    node: Node,
    cls: type[S],
    on_change: Callable[[S], None] | None = None,
    check: Callable[[S], None] = lambda _settings: None,
) -> S:
    """Declare a parameter for each field of a settings dataclass and return the values.

    A whole number given for a double is taken as one, as it is in ``vislam solve``.

    Parameters
    ----------
    node : Node
    cls : type
        Frozen dataclass whose fields were made with :func:`vislam_ros.core.settings.setting`.
    on_change : callable, optional
        Called with new settings after a parameter was set at run time. Without it all parameters
        are read-only, and with it those whose setting is not live.
    check : callable, optional
        Raises a SettingsError where new settings cannot be taken now, though they are in range.

    Raises
    ------
    SettingsError
        Where an override has the wrong type or is out of range.
    """
    fields = dataclasses.fields(cls)
    overrides = _overrides(node)
    settings = settings_from_dict(
        cls, {field.name: overrides[field.name] for field in fields if field.name in overrides}
    )
    for field in fields:
        value = getattr(settings, field.name)
        node.declare_parameter(
            field.name,
            list(value) if isinstance(value, tuple) else value,
            _descriptor(field, read_only=on_change is None or not is_live(field)),
            ignore_override=True,
        )
    if on_change is not None:
        _follow_changes(node, cls, on_change, check)
    return settings


def declare_slam_settings(
    node: Node,
    on_change: Callable[[SlamSettings], None] | None = None,
    check: Callable[[SlamSettings], None] = lambda _settings: None,
) -> SlamSettings:
    """Declare the parameters of the chosen estimator and return their values.

    Those of other estimators are checked and not declared: they change nothing, and a line in
    the log tells so where one was given other than its default.

    Raises
    ------
    SettingsError
        As :func:`declare_settings`, and where there is no such estimator.
    """
    values = estimator_overrides(node)
    settings = declare_settings(node, type(slam_settings(values)), on_change, check)
    note = unused_note(values)
    if note:
        node.get_logger().warning(note)
    return settings


def estimator_overrides(node: Node) -> dict[str, Any]:
    """Settings of estimators that a node was given, of the chosen one or another."""
    overrides = _overrides(node)
    return {name: overrides[name] for name in setting_owners(overrides) if name in overrides}


def undeclared_overrides(node: Node, known: Container[str] = ()) -> dict[str, str]:
    """Names given to a node that are neither declared nor known, with a hint at one declared."""
    declared = list(node.get_parameters_by_prefix(""))
    return {
        name: nearest_name(name, declared)
        for name in _overrides(node)
        if not node.has_parameter(name) and name not in known
    }


def warn_of_undeclared_overrides(node: Node, known: Container[str] = ()) -> None:
    """Log a line for each override that rclpy would pass over in silence, but for those known.

    This comes last in a node: subscriptions and publishers declare parameters, too.
    """
    for name, hint in undeclared_overrides(node, known).items():
        node.get_logger().warning(f"{name}: no such parameter, it has no effect{hint}")


def _overrides(node: Node) -> dict[str, Any]:
    # rclpy offers no public way to see what was given but never declared.
    return {name: parameter.value for name, parameter in node._parameter_overrides.items()}


def _descriptor(field: "dataclasses.Field[Any]", *, read_only: bool) -> ParameterDescriptor:
    metadata = field.metadata
    # A user's own settings may be plain fields.
    low, high = metadata.get("minimum"), metadata.get("maximum")
    choices = f" ({', '.join(metadata['choices'])})" if metadata.get("choices") else ""
    descriptor = ParameterDescriptor(
        description=metadata.get("description", "") + choices,
        read_only=read_only,
        additional_constraints="holds from the start of the node to its end" if read_only else "",
    )
    if low is None and high is None:
        return descriptor
    if isinstance(field.default, int):
        largest = 2**63 - 1
        whole = IntegerRange(
            from_value=-largest if low is None else int(low),
            to_value=largest if high is None else int(high),
        )
        descriptor.integer_range = [whole]
    else:
        largest_float = sys.float_info.max
        real = FloatingPointRange(
            from_value=-largest_float if low is None else float(low),
            to_value=largest_float if high is None else float(high),
        )
        descriptor.floating_point_range = [real]
    return descriptor


def _follow_changes(
    node: Node, cls: type[S], on_change: Callable[[S], None], check_now: Callable[[S], None]
) -> None:
    names = {field.name for field in dataclasses.fields(cls)}

    def current(changes: list[Parameter]) -> S:
        values = {name: node.get_parameter(name).value for name in names}
        values.update({change.name: change.value for change in changes if change.name in names})
        for name, value in values.items():
            if isinstance(value, array):  # rclpy's list of numbers
                values[name] = value.tolist()
        return settings_from_dict(cls, values)

    def concern(changes: list[Parameter]) -> bool:
        return any(change.name in names for change in changes)

    def check(changes: list[Parameter]) -> SetParametersResult:
        if not concern(changes):
            return SetParametersResult(successful=True)
        try:
            check_now(current(changes))
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(changes: list[Parameter]) -> None:
        if concern(changes):
            on_change(current(changes))

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(apply)
