# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Asking other nodes for their parameters, without waiting."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

Parameters = dict[str, dict[str, Any]]


class ParameterQuery:
    """Asks each of some nodes once.

    Parameters
    ----------
    node : Node
        The one that asks.
    names : mapping of str to sequence of str
        Parameters to ask for, by node.
    on_answer : callable
        Called with a node's name and values for each node that answers.
    """

    def __init__(
        self,
        node: Node,
        names: Mapping[str, Sequence[str]],
        on_answer: Callable[[str, dict[str, Any]], None],
    ):
        self._names = names
        self._on_answer = on_answer
        self._unasked: dict[str, Client] = {
            other: node.create_client(GetParameters, f"{other}/get_parameters") for other in names
        }
        self._unanswered = set(names)

    @property
    def complete(self) -> bool:
        """Whether every node has answered."""
        return not self._unanswered

    def ask(self) -> None:
        """Ask the nodes that are here and were not asked yet."""
        for other, client in list(self._unasked.items()):
            if client.service_is_ready():
                del self._unasked[other]
                future = client.call_async(GetParameters.Request(names=list(self._names[other])))
                future.add_done_callback(lambda future, other=other: self._take(other, future))

    def _take(self, other: str, future: Future) -> None:
        names, values = self._names[other], future.result().values
        self._unanswered.discard(other)
        known = {
            name: parameter_value_to_python(value)
            for name, value in zip(names, values, strict=False)
        }
        self._on_answer(other, {name: value for name, value in known.items() if value is not None})
