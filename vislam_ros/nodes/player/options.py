# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a player is told and what it reports."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from vislam_ros.errors import VislamError


@dataclass(frozen=True)
class PlayOptions:
    """How to play a bag.

    Attributes
    ----------
    rate : float
        Bag seconds in a second; 0 is as fast as the graph takes it.
    start_offset, duration : float
        Part of the bag to play, seconds from its beginning; infinite to its end.
    passes : int
        How often; 0 is until interrupted.
    delay : float
        Seconds to wait before the first message, once the subscribers are there.
    start_paused : bool
    topics : tuple of str
        Topics to play; empty means all.
    namespace : str
        Of the player and, unless the bag has it, of what it plays; empty is the outermost one.
    remap : tuple of str
        ROS remapping rules ``from:=to``, by the names that the bag has.
    clock_rate : float
        How often to publish /clock, Hz; 0 does not.
    wait : float
        Seconds to wait for the subscribers.
    subscribers : int
        How many subscribers the features and the twist each need.
    whole_graph : bool
        Wait until all nodes of the graph hear each other, too.
    window : int
        At rate 0, how many feature frames may be ahead of ``slam/odometry``.
    """

    rate: float = 1.0
    start_offset: float = 0.0
    duration: float = math.inf
    passes: int = 1
    delay: float = 0.0
    start_paused: bool = False
    topics: tuple[str, ...] = ()
    namespace: str = ""
    remap: tuple[str, ...] = ()
    clock_rate: float = 0.0
    wait: float = 10.0
    subscribers: int = 1
    whole_graph: bool = False
    window: int = 32

    def require_part(self, bag: Path, seconds: float) -> None:
        """Raise a VislamError where no part of a bag that lasts so long is to be played."""
        if self.start_offset > seconds:
            raise VislamError(
                f"{bag}: --start-offset {self.start_offset:g} is past its end: it lasts "
                f"{seconds:.3f} s"
            )
        if self.duration <= 0.0:
            raise VislamError(
                f"{bag}: --duration {self.duration:g} plays nothing: give more than 0 s"
            )


@dataclass
class PlayReport:
    """What a player did, filled while it plays.

    Attributes
    ----------
    state : str
        ``finished`` or ``interrupted``; empty until the end.
    messages, passes : int
        Messages sent and whole passes over the bag.
    bag_seconds, wall_seconds : float
        Bag time played and the time that took, pauses left out.
    delivered : bool
        Whether every subscriber acknowledged all that it was sent.
    untaken : dict of str to int
        Messages that were sent while nobody subscribed, by topic.
    """

    state: str = ""
    messages: int = 0
    passes: int = 0
    bag_seconds: float = 0.0
    wall_seconds: float = 0.0
    delivered: bool = False
    untaken: dict[str, int] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Bag seconds in a second, as achieved."""
        return self.bag_seconds / self.wall_seconds if self.wall_seconds > 0.0 else 0.0
