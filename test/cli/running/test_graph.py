# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A run ends when its recorder says so."""

import time
from contextlib import closing

from places import REPOSITORY

from vislam_ros.cli.live_view import RunView
from vislam_ros.cli.processes import prepared_children
from vislam_ros.cli.running.drawing import Pictures
from vislam_ros.cli.running.graph import wait_until_recorded
from vislam_ros.cli.running.watch import Watch
from vislam_ros.data.results.recording import PLAYER_INTERRUPTED, Recording


def test_a_player_that_was_interrupted_and_does_not_leave_holds_nothing_up(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{REPOSITORY}:{tmp_path}")
    (tmp_path / "idle.py").write_text("def main():\n    return 0\n")
    results = tmp_path / "run"
    recording = Recording(results, force=True, record_mcap=False)
    recording.finish(complete=False, reason=PLAYER_INTERRUPTED)
    view = RunView(lambda *_: None, None)
    with prepared_children({"player": ("idle",)}) as prepared:
        player = prepared["player"]
        with closing(Watch([player])) as watch:
            began = time.monotonic()
            wait_until_recorded(watch, player, results, view, Pictures(tmp_path, "", wanted=False))
            assert time.monotonic() - began < 4.0
        assert player.exit_code is None
