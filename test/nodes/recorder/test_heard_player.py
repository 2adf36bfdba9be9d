# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from vislam_ros.core.tracking.refusals import RefusedMessage
from vislam_ros.nodes import conversions
from vislam_ros.nodes.recorder.heard_player import HeardPlayer


def status(**values):
    entry = conversions.status("player", values)
    return conversions.status_array(conversions.stamp_to_message(0), [entry])


def test_what_a_player_tells_is_news_once():
    player = HeardPlayer()
    assert not player.is_there
    told = status(state="playing", **{"sent imu/twist": 3})
    assert [player.take(told), player.take(told)] == [True, False]
    assert (player.state, player.sent, player.has_ended) == ("playing", {"imu/twist": 3}, False)
    assert player.take(status(state="finished", **{"sent imu/twist": 3}))
    assert player.is_there
    assert player.has_ended


@pytest.mark.parametrize("values", [{}, {"state": "playing", "sent imu/twist": "many"}])
def test_a_status_that_tells_nothing_changes_nothing(values):
    player = HeardPlayer()
    with pytest.raises(RefusedMessage):
        player.take(status(**values))
    assert (player.state, player.sent) == ("absent", {})
