# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A subscription hears ordinary publishers, and reliable ones without a loss."""

import itertools
import time

import pytest
import rclpy
from live.node_processes import wait_until
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Int32, String

from vislam_ros.data.bags.layout import DIAGNOSTICS, LATCHED_QOS, STREAM_QOS, Topic
from vislam_ros.errors import SettingsError
from vislam_ros.nodes import conversions
from vislam_ros.nodes.diagnostics import Monitor
from vislam_ros.nodes.subscribing import MatchingSubscription, fitting, mismatch

WAIT = 20.0
RELIABILITIES = (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
DURABILITIES = (DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE)


def profile(reliability, durability=DurabilityPolicy.VOLATILE):
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=1000, reliability=reliability, durability=durability
    )


PROFILES = [profile(*pair) for pair in itertools.product(RELIABILITIES, DURABILITIES)]
RELIABLE, BEST_EFFORT = profile(RELIABILITIES[0]), profile(RELIABILITIES[1])


class Hearer(Node):
    def __init__(self, **options):
        super().__init__("hearer", **options)
        self.monitor = Monitor(self, lambda: ("running", {}))
        self.heard = []

    def hear(self, qos):
        self.monitor.subscribe(Topic("words", "std_msgs/msg/String", qos), self.take)

    def take(self, message):
        self.heard.append(message.data)


class Speaker(Node):
    def __init__(self, **options):
        super().__init__("speaker", **options)


@pytest.fixture
def graph(make_node, context):
    """A hearer, a speaker, and how to spin both."""
    hearer, speaker = make_node(Hearer), make_node(Speaker)
    executor = SingleThreadedExecutor(context=context)
    for node in (hearer, speaker):
        executor.add_node(node)

    def spin_until(condition, what):
        deadline = time.monotonic() + WAIT
        while not condition():
            assert time.monotonic() < deadline, f"{what} did not happen: {hearer.heard}"
            executor.spin_once(timeout_sec=0.05)

    yield hearer, speaker, spin_until
    executor.shutdown()


@pytest.mark.parametrize("wanted", PROFILES)
@pytest.mark.parametrize("offered", PROFILES)
def test_a_fitting_profile_hears_the_publisher_and_asks_for_no_less_than_need_be(offered, wanted):
    found = fitting([offered], wanted)
    assert not mismatch(offered, found)
    if not mismatch(offered, wanted):
        assert (found.reliability, found.durability) >= (offered.reliability, offered.durability)
    stronger_fits = [
        other
        for other in PROFILES
        if not mismatch(offered, other) and not mismatch(wanted, other) and mismatch(found, other)
    ]
    assert stronger_fits == []


@pytest.mark.parametrize("offered", PROFILES)
@pytest.mark.parametrize("wanted", [STREAM_QOS, LATCHED_QOS], ids=["stream", "latched"])
def test_any_publisher_is_heard_whether_it_comes_first_or_last(graph, offered, wanted):
    hearer, speaker, spin_until = graph
    early = speaker.create_publisher(String, "words", offered)
    hearer.hear(wanted)
    spin_until(early.get_subscription_count, "the match of the early one")
    early.publish(String(data="early"))
    spin_until(lambda: hearer.heard == ["early"], "the first word")
    speaker.destroy_publisher(early)
    late = speaker.create_publisher(String, "words", offered)
    spin_until(late.get_subscription_count, "the match of the late one")
    late.publish(String(data="late"))
    spin_until(lambda: hearer.heard == ["early", "late"], "the second word")


def test_a_reliable_publisher_is_heard_once_where_a_best_effort_one_was_before(graph):
    _, speaker, spin_until = graph
    heard = []
    MatchingSubscription(speaker, Topic("words", "std_msgs/msg/String"), heard.append)
    loose = speaker.create_publisher(String, "words", BEST_EFFORT)
    spin_until(loose.get_subscription_count, "the match of the best-effort one")
    loose.publish(String(data="loose"))
    spin_until(lambda: len(heard) == 1, "the loose word")
    firm = speaker.create_publisher(String, "words", RELIABLE)
    # Both subscriptions match, and there was no turn yet to close the one.
    wait_until(lambda: firm.get_subscription_count() == 2, "the match of the reliable one")
    words = [str(k) for k in range(200)]
    for word in words:
        firm.publish(String(data=word))
    spin_until(lambda: deserialize_message(heard[-1], String).data == words[-1], "all words")
    assert [deserialize_message(data, String).data for data in heard] == ["loose", *words]


@pytest.mark.parametrize("offered", [RELIABLE, BEST_EFFORT], ids=["reliable", "best effort"])
def test_a_second_subscription_is_for_publishers_that_do_not_fit(make_node, monkeypatch, offered):
    node, speaker = make_node(Hearer), make_node(Speaker)
    hearing = MatchingSubscription(node, Topic("words", "std_msgs/msg/String"), print)
    speaker.create_publisher(String, "words", offered)
    wait_until(lambda: node.count_publishers("words"), "the publisher")
    # It is known before it is matched.
    monkeypatch.setattr(type(hearing._first), "get_publisher_count", lambda _: 0)
    hearing.look()
    assert hearing.heard_as() == mismatch(offered, RELIABLE)
    subscriptions = [one for one in node.subscriptions if one.topic_name == "/words"]
    assert len(subscriptions) == (2 if hearing.heard_as() else 1)


def status_of(hearer, published):
    message = published[DIAGNOSTICS.name][-1]
    return message.status[0], conversions.status_values(message, "/hearer")


def test_how_a_best_effort_publisher_is_heard_is_told_and_no_warning(graph, capture):
    hearer, speaker, spin_until = graph
    published = capture(hearer)
    hearer.hear(STREAM_QOS)
    loose = speaker.create_publisher(String, "words", BEST_EFFORT)
    spin_until(loose.get_subscription_count, "the match")
    hearer.monitor.report()
    status, values = status_of(hearer, published)
    assert (status.level, status.message) == (b"\x00", "running")
    assert values["heard words"] == "reliability best_effort, not reliable"


@pytest.fixture
def foreign_speaker(domain_id):
    """A speaker of another process, as it were: it need not agree with ours on types."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    speaker = Speaker(context=context)
    yield speaker
    speaker.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize(
    ("msgtype", "qos", "reason"),
    [
        (String, BEST_EFFORT, "reliability best_effort, not reliable"),
        (Int32, RELIABLE, "type std_msgs/msg/Int32, not std_msgs/msg/String"),
    ],
)
def test_a_publisher_that_cannot_be_heard_beside_another_is_a_warning_until_it_is_gone(
    graph, capture, foreign_speaker, msgtype, qos, reason
):
    hearer, speaker, spin_until = graph
    published = capture(hearer)
    hearer.hear(STREAM_QOS)
    heard = speaker.create_publisher(String, "words", RELIABLE)
    spin_until(heard.get_subscription_count, "the match")
    unheard = foreign_speaker.create_publisher(msgtype, "words", qos)

    def warns():
        return any(message.status[0].level == b"\x01" for message in published[DIAGNOSTICS.name])

    spin_until(warns, "the warning")
    status, _ = status_of(hearer, published)
    assert status.message.startswith("running; cannot hear ")
    assert status.message.endswith(f" on words ({reason})")
    foreign_speaker.destroy_publisher(unheard)
    spin_until(lambda: published[DIAGNOSTICS.name][-1].status[0].level == b"\x00", "the end of it")


def test_the_quality_of_service_can_be_overridden_by_parameters(make_node):
    name = "qos_overrides./words.subscription"
    node = make_node(
        Hearer,
        **{
            f"{name}.reliability": "best_effort",
            f"{name}.history": "keep_last",
            f"{name}.depth": 7,
        },
    )
    node.hear(STREAM_QOS)
    (subscription,) = [one for one in node.subscriptions if one.topic_name == "/words"]
    assert subscription.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert subscription.qos_profile.history is HistoryPolicy.KEEP_LAST
    assert subscription.qos_profile.depth == 7
    assert node.get_parameter(f"{name}.durability").value == "volatile"


@pytest.mark.parametrize(
    ("policy", "value", "words"),
    [
        ("reliability", "sometimes", "sometimes"),
        ("reliability", 7, "reliability"),
        ("history", "keep_last", "depth"),
    ],
)
def test_an_override_that_is_no_policy_is_refused_in_one_line(make_node, policy, value, words):
    node = make_node(Hearer, **{f"qos_overrides./words.subscription.{policy}": value})
    with pytest.raises(SettingsError, match="words") as error:
        node.hear(STREAM_QOS)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_bytes_come_as_they_were_sent(make_node, context):
    node, speaker = make_node(Hearer), make_node(Speaker)
    heard = []
    MatchingSubscription(node, Topic("words", "std_msgs/msg/String"), heard.append)
    publisher = speaker.create_publisher(String, "words", BEST_EFFORT)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    deadline = time.monotonic() + WAIT
    while not heard:
        assert time.monotonic() < deadline
        publisher.publish(String(data="a"))
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    assert deserialize_message(heard[0], String).data == "a"
