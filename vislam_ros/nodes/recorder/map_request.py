# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Asking slam_node for its map, without waiting."""

from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from vislam_ros.data.trajectory import stamp_from_text, stamp_text

_AS_OF = " landmarks as of "


def map_answer(landmarks: int, stamp: int) -> str:
    """Message with which slam_node answers: how many it has published, and as of when (ns)."""
    return f"{landmarks}{_AS_OF}{stamp_text(stamp)} s"


def stamp_of_map_answer(message: str) -> int:
    """Stamp (ns) in a :func:`map_answer`; raises a ValueError where it is none."""
    return stamp_from_text(message.partition(_AS_OF)[2].removesuffix(" s"))


class MapRequest:
    """Asks for the map once as of each last step.

    Parameters
    ----------
    node : Node
    on_map : callable
        Called with the stamp (ns) as of which a map was published for it.

    Attributes
    ----------
    answered : bool
        Whether the last request was answered.
    stamp : int or None
        As of when (ns) the map is that was published for it.
    """

    def __init__(self, node: Node, on_map: Callable[[int], None]):
        self._on_map = on_map
        self._client = node.create_client(Trigger, "slam_node/publish_landmarks")
        self._asked: tuple[int | None] | None = None
        self._pending: Future | None = None
        self.answered = False
        self.stamp: int | None = None

    @property
    def is_possible(self) -> bool:
        """Whether somebody is there who could answer."""
        return self._client.service_is_ready()

    @property
    def failed(self) -> bool:
        """Whether the answer was that there is no map."""
        return self.answered and self.stamp is None

    def ask(self, last_stamp: int | None) -> None:
        """Ask, unless that was done with this last step (ns), or before any."""
        if self._asked == (last_stamp,) or not self.is_possible:
            return
        self._asked, self.answered, self.stamp = (last_stamp,), False, None
        self._pending = self._client.call_async(Trigger.Request())
        self._pending.add_done_callback(self._take)

    def _take(self, future: Future) -> None:
        if future is not self._pending:
            return  # asked anew since
        response = future.result()
        self.answered = True
        if response.success:
            self.stamp = stamp_of_map_answer(response.message)
            self._on_map(self.stamp)
