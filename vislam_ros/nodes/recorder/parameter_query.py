# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Asking other nodes for their parameters, without waiting."""

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

Parameters = dict[str, dict[str, Any]]

# Declared by rclpy for every node.
_RCLPYS = {"use_sim_time", "start_type_description_service"}


class ParameterQuery:
    """Asks each of some nodes once for all that it declares.

    Parameters
    ----------
    node : Node
        The one that asks.
    others : sequence of str
        Names of those that are asked.
    on_answer : callable
        Called with a node's name and values for each node that answers.
    if_there : sequence of str
        Names of others, which need not be there.
    """

    def __init__(
        self,
        node: Node,
        others: Sequence[str],
        on_answer: Callable[[str, dict[str, Any]], None],
        if_there: Sequence[str] = (),
    ):
        self._on_answer = on_answer
        self._unanswered = set(others)
        self._unasked: dict[str, tuple[Client, Client]] = {
            other: (
                node.create_client(ListParameters, f"{other}/list_parameters"),
                node.create_client(GetParameters, f"{other}/get_parameters"),
            )
            for other in (*others, *if_there)
        }

    @property
    def complete(self) -> bool:
        """Whether every node has answered that must be there."""
        return not self._unanswered

    def expect(self, other: str) -> None:
        """Wait for the answer of one that need not be there: it is, and may be found late."""
        if other in self._unasked:
            self._unanswered.add(other)

    def ask(self) -> None:
        """Ask the nodes that are here and were not asked yet."""
        for other, (names, values) in list(self._unasked.items()):
            if names.service_is_ready() and values.service_is_ready():
                del self._unasked[other]
                self._unanswered.add(other)
                # No deeper than this lie the parameters of the nodes, and not those of QoS.
                future = names.call_async(ListParameters.Request(depth=1))
                future.add_done_callback(
                    lambda future, other=other, values=values: self._ask_values(
                        other, values, future
                    )
                )

    def _ask_values(self, other: str, client: Client, future: Future) -> None:
        names = [name for name in future.result().result.names if name not in _RCLPYS]
        asked = client.call_async(GetParameters.Request(names=names))
        asked.add_done_callback(lambda future: self._take(other, names, future))

    def _take(self, other: str, names: list[str], future: Future) -> None:
        self._unanswered.discard(other)
        values = map(parameter_value_to_python, future.result().values)
        self._on_answer(other, dict(zip(names, values, strict=False)))
