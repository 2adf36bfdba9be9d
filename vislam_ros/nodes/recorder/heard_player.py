# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the recorder hears of the player."""

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray

from vislam_ros.core.tracking.refusals import Refusal, RefusedMessage
from vislam_ros.data.bags.layout import PLAYER
from vislam_ros.data.results.completeness import counts_from_values
from vislam_ros.nodes import conversions


class HeardPlayer:
    """The player as it last told of itself.

    Attributes
    ----------
    state : str
        ``absent`` until it is heard.
    sent : mapping of str to int
        How many messages it has sent, by topic.
    """

    def __init__(self) -> None:
        self.state = "absent"
        self.sent: Mapping[str, int] = {}

    def take(self, message: DiagnosticArray) -> bool:
        """Take its status; tell whether it is news.

        Raises
        ------
        RefusedMessage
            ``bad_fields``, where a value is missing or is no number.
        """
        values = conversions.status_values(message, "player")
        before = self.state, self.sent
        try:
            self.state, self.sent = values["state"], counts_from_values(values, "sent ")
        except KeyError as error:
            raise RefusedMessage(Refusal.BAD_FIELDS, f"{PLAYER.name}: {error!r}") from error
        return (self.state, self.sent) != before

    @property
    def is_there(self) -> bool:
        """Whether there is or was one."""
        return self.state != "absent"

    @property
    def has_ended(self) -> bool:
        """Whether it sends nothing more."""
        return self.state in ("finished", "interrupted")
