# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A player that is paused, stepped, interrupted, or waits for the graph."""

import dataclasses

from live.listening import FULL_SPEED, STEPS, WAIT, wait_until
from std_srvs.srv import Trigger

from vislam_ros.data.bags.layout import FEATURES, TWIST


def call(node, name):
    client = node.create_client(Trigger, f"player/{name}")
    assert client.wait_for_service(WAIT)
    future = client.call_async(Trigger.Request())
    wait_until(future.done, f"the answer of player/{name}")
    assert future.result().success


def test_services_pause_step_and_resume(listen, make_player, play_in_thread):
    listener = listen()
    features = listener.heard[FEATURES.recorded]
    report = play_in_thread(make_player(dataclasses.replace(FULL_SPEED, start_paused=True)))
    wait_until(lambda: listener.states and listener.states[-1]["state"] == "paused", "the pause")
    for count in (1, 2):
        call(listener, "step")
        wait_until(lambda n=count: len(features) == n, "a step")
        # The twist of the step came with it, and nothing from after it.
        wait_until(lambda n=count: len(listener.heard[TWIST.recorded]) == n, "its twist")
    call(listener, "resume")
    assert report().state == "finished"
    wait_until(lambda: len(features) == STEPS, "the rest")
    call_states = [status["state"] for status in listener.states]
    wait_until(lambda: listener.states[-1]["state"] == "finished", "the last status")
    assert "paused" in call_states


def test_a_pause_in_the_middle_holds_the_messages(listen, make_player, play_in_thread):
    listener = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, rate=1.0))
    report = play_in_thread(node)
    wait_until(lambda: len(listener.heard[FEATURES.recorded]) > 2, "the first features")
    call(listener, "pause")
    position = node.clock.position()
    assert node.state == "paused"
    assert node.clock.position() == position
    node.clock.interrupt()
    assert report().state == "interrupted"


def test_an_interrupt_is_said_to_those_who_come_later(listen, make_player, play_in_thread):
    first = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, rate=0.1, passes=0))
    report = play_in_thread(node)
    wait_until(lambda: first.heard[FEATURES.recorded], "the first features")
    node.clock.interrupt()
    assert report().state == "interrupted"
    later = listen()
    wait_until(lambda: later.states, "the status")
    assert later.states[-1]["state"] == "interrupted"
    assert int(later.states[-1]["messages_sent"]) == report().messages


def test_an_interrupt_ends_the_wait_for_subscribers(make_player, play_in_thread):
    node = make_player(dataclasses.replace(FULL_SPEED, wait=1000.0))
    report = play_in_thread(node)
    node.clock.interrupt()
    assert (report().state, report().messages) == ("interrupted", 0)


def test_without_subscribers_it_plays_after_the_wait(make_player, bag):
    report = make_player(dataclasses.replace(FULL_SPEED, wait=0.1)).play()
    assert report.state == "finished"
    assert report.messages >= STEPS


def test_it_waits_until_the_whole_graph_is_there(listen, make_player, play_in_thread):
    listener = listen()
    node = make_player(dataclasses.replace(FULL_SPEED, whole_graph=True))
    report = play_in_thread(node)
    wait_until(lambda: listener.states, "the first status")
    wait_until(lambda: node.count_subscribers(FEATURES.recorded), "the discovery")
    assert not listener.heard[FEATURES.recorded]
    node.clock.interrupt()
    assert report().messages == 0
