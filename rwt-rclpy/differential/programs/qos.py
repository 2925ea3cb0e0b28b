"""Quality of service: profiles, compatibility, matching, events."""

import warnings
from itertools import product
from typing import Any

import rclpy
from rclpy.duration import Duration, Infinite
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_profile_sensor_data,
    qos_profile_system_default,
)
from std_msgs.msg import Int32, String

from differential.steps import PATIENCE_S, QUIET_S, node, spinner, tell, wait, with_logs

RELIABILITY = (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
DURABILITY = (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
SPANS_S = (0, 1, 2)
LIVELINESS = (LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC)


def _delivered(offered: QoSProfile, requested: QoSProfile, *, late: bool = False) -> None:
    with node() as made, spinner(made) as spin:
        received: list[int] = []
        publisher = made.create_publisher(Int32, "topic", offered)
        if late:
            publisher.publish(Int32(data=0))
        subscription = made.create_subscription(Int32, "topic", lambda m: received.append(m.data), requested)
        spin(lambda: publisher.get_subscription_count(), QUIET_S)
        for number in (1, 2, 3):
            publisher.publish(Int32(data=number))
        spin(lambda: len(received) >= 3 + late, 1.0)
        print(publisher.get_subscription_count(), subscription.get_publisher_count(), received)


def best_effort_to_reliable() -> None:
    """The most common fault: sensors publish best-effort."""
    _delivered(qos_profile_sensor_data, QoSProfile(depth=10))


def reliable_to_best_effort() -> None:
    """Compatible."""
    _delivered(QoSProfile(depth=10), qos_profile_sensor_data)


def volatile_to_transient_local() -> None:
    """Incompatible."""
    _delivered(QoSProfile(depth=10), QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))


def transient_local_to_volatile() -> None:
    """Compatible, without the samples from before."""
    _delivered(
        QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL), QoSProfile(depth=10), late=True
    )


def transient_local_late() -> None:
    """A late subscription receives what was published before."""
    latched = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    with node() as made, spinner(made) as spin:
        received: list[int] = []
        publisher = made.create_publisher(Int32, "topic", latched)
        for number in range(5):
            publisher.publish(Int32(data=number))
        made.create_subscription(Int32, "topic", lambda m: received.append(m.data), latched)
        spin(lambda: len(received) == 2)
        spin(seconds=QUIET_S)
        print(received)


def deadline_longer_than_requested() -> None:
    """Incompatible."""
    _delivered(
        QoSProfile(depth=1, deadline=Duration(seconds=2)), QoSProfile(depth=1, deadline=Duration(seconds=1))
    )


def deadline_not_offered() -> None:
    """Incompatible."""
    _delivered(QoSProfile(depth=1), QoSProfile(depth=1, deadline=Duration(seconds=1)))


def liveliness_automatic_to_manual() -> None:
    """Incompatible."""
    _delivered(
        QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC),
        QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC),
    )


def lease_longer_than_requested() -> None:
    """Incompatible."""
    _delivered(
        QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=2)),
        QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1)),
    )


def best_available_subscription() -> None:
    """The subscription follows the publisher."""
    _delivered(qos_profile_sensor_data, QoSPresetProfiles.BEST_AVAILABLE.value)


def best_available_durability() -> None:
    """A subscription that follows a transient-local publisher receives what was published before."""
    _delivered(
        QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL),
        QoSPresetProfiles.BEST_AVAILABLE.value,
        late=True,
    )


def system_default_profile() -> None:
    """The middleware's defaults."""
    _delivered(qos_profile_system_default, QoSProfile(depth=10))


def incompatible_events() -> None:
    """Both sides learn of an incompatible pair."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        offers = PublisherEventCallbacks(incompatible_qos=lambda e: told.append(("publisher", e)))
        requests = SubscriptionEventCallbacks(incompatible_qos=lambda e: told.append(("subscription", e)))
        made.create_publisher(Int32, "topic", qos_profile_sensor_data, event_callbacks=offers)
        made.create_subscription(Int32, "topic", print, 10, event_callbacks=requests)
        spin(lambda: len(told) == 2)
        for side, event in sorted(told, key=lambda each: each[0]):
            print(side, event.total_count, event.total_count_change, int(event.last_policy_kind))


def incompatible_events_of_several() -> None:
    """Incompatible pairs are counted."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        offers = PublisherEventCallbacks(incompatible_qos=told.append)
        made.create_publisher(Int32, "topic", QoSProfile(depth=1), event_callbacks=offers)
        for _ in range(3):
            made.create_subscription(
                Int32, "topic", print, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            )
        spin(lambda: told and told[-1].total_count == 3)
        print(
            told[-1].total_count,
            sum(each.total_count_change for each in told),
            int(told[-1].last_policy_kind),
        )


def _policy_of_event(offered: QoSProfile, requested: QoSProfile) -> None:
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        requests = SubscriptionEventCallbacks(incompatible_qos=told.append)
        made.create_publisher(Int32, "topic", offered)
        made.create_subscription(Int32, "topic", print, requested, event_callbacks=requests)
        spin(lambda: told)
        print(rclpy.qos.qos_policy_name_from_kind(told[0].last_policy_kind), int(told[0].last_policy_kind))


def policy_of_event_durability() -> None:
    """The event names the policy."""
    _policy_of_event(QoSProfile(depth=1), QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))


def policy_of_event_deadline() -> None:
    """The event names the policy."""
    _policy_of_event(QoSProfile(depth=1), QoSProfile(depth=1, deadline=Duration(seconds=1)))


def policy_of_event_liveliness() -> None:
    """The event names the policy."""
    _policy_of_event(
        QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC),
        QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC),
    )


def policy_of_event_lease() -> None:
    """The event names the policy."""
    _policy_of_event(QoSProfile(depth=1), QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1)))


def policy_of_event_of_two() -> None:
    """With two incompatible policies, the event names one."""
    _policy_of_event(
        qos_profile_sensor_data, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )


def policy_of_event_of_all() -> None:
    """With all policies incompatible, the event names one."""
    _policy_of_event(
        qos_profile_sensor_data,
        QoSProfile(
            depth=1,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
            deadline=Duration(seconds=1),
            liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
            liveliness_lease_duration=Duration(seconds=1),
        ),
    )


@with_logs
def incompatible_warnings() -> None:
    """Without callbacks, both sides warn."""
    with node() as made, spinner(made) as spin:
        made.create_publisher(Int32, "topic", qos_profile_sensor_data)
        spin(seconds=0.1)
        made.create_subscription(Int32, "topic", print, 10)
        spin(seconds=PATIENCE_S)


@with_logs
def incompatible_warnings_off() -> None:
    """Default callbacks can be turned off."""
    with node() as made, spinner(made) as spin:
        offers = PublisherEventCallbacks(use_default_callbacks=False)
        requests = SubscriptionEventCallbacks(use_default_callbacks=False)
        made.create_publisher(Int32, "topic", qos_profile_sensor_data, event_callbacks=offers)
        made.create_subscription(Int32, "topic", print, 10, event_callbacks=requests)
        spin(seconds=0.5)


@with_logs
def incompatible_warning_in_namespace() -> None:
    """Warnings name the node's logger and the topic as it was given."""
    with node("camera", namespace="robot") as made, spinner(made) as spin:
        made.create_publisher(Int32, "~/image", qos_profile_sensor_data)
        spin(seconds=0.1)
        made.create_subscription(Int32, "camera/image", print, 10)
        spin(seconds=PATIENCE_S)


def matched_events() -> None:
    """Both sides learn of a match."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        offers = PublisherEventCallbacks(matched=lambda e: told.append(("publisher", e)))
        requests = SubscriptionEventCallbacks(matched=lambda e: told.append(("subscription", e)))
        made.create_publisher(Int32, "topic", 10, event_callbacks=offers)
        made.create_subscription(Int32, "topic", print, 10, event_callbacks=requests)
        spin(lambda: len(told) == 2)
        for side, event in sorted(told, key=lambda each: each[0]):
            print(
                side,
                event.total_count,
                event.total_count_change,
                event.current_count,
                event.current_count_change,
            )


def matched_events_after_destroy() -> None:
    """A publisher learns that a subscription left."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        offers = PublisherEventCallbacks(matched=told.append)
        made.create_publisher(Int32, "topic", 10, event_callbacks=offers)
        subscription = made.create_subscription(Int32, "topic", print, 10)
        spin(lambda: told)
        made.destroy_subscription(subscription)
        spin(lambda: len(told) == 2)
        event = told[-1]
        print(event.total_count, event.total_count_change, event.current_count, event.current_count_change)


def matched_only_if_compatible() -> None:
    """An incompatible pair is not matched."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        offers = PublisherEventCallbacks(matched=told.append)
        made.create_publisher(Int32, "topic", qos_profile_sensor_data, event_callbacks=offers)
        made.create_subscription(Int32, "topic", print, 10)
        spin(seconds=QUIET_S)
        print(told)


def deadline_missed() -> None:
    """Both sides learn of a missed deadline."""
    qos = QoSProfile(depth=1, deadline=Duration(seconds=0.2))
    with node() as made, spinner(made) as spin:
        told: list[str] = []
        offers = PublisherEventCallbacks(deadline=lambda e: told.append(f"offered {e.total_count_change}"))
        requests = SubscriptionEventCallbacks(
            deadline=lambda e: told.append(f"requested {e.total_count_change}")
        )
        publisher = made.create_publisher(Int32, "topic", qos, event_callbacks=offers)
        made.create_subscription(Int32, "topic", lambda _: None, qos, event_callbacks=requests)
        spin(lambda: publisher.get_subscription_count())
        publisher.publish(Int32())
        spin(lambda: len(told) >= 2)
        print(sorted(set(told[:2])))


def liveliness_changed() -> None:
    """A subscription learns of publishers that are alive."""
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_subscription(
            Int32, "topic", print, 10, event_callbacks=SubscriptionEventCallbacks(liveliness=told.append)
        )
        publisher = made.create_publisher(Int32, "topic", 10)
        spin(lambda: told)
        made.destroy_publisher(publisher)
        spin(lambda: len(told) == 2)
        for event in told:
            print(
                event.alive_count,
                event.alive_count_change,
                event.not_alive_count,
                event.not_alive_count_change,
            )


def liveliness_lost() -> None:
    """A publisher that must assert its liveliness learns that it did not."""
    qos = QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=0.2),
    )
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        publisher = made.create_publisher(
            Int32, "topic", qos, event_callbacks=PublisherEventCallbacks(liveliness=told.append)
        )
        publisher.assert_liveliness()
        spin(lambda: told)
        print(told[0].total_count, told[0].total_count_change)


def liveliness_lost_at_subscription() -> None:
    """A subscription learns of a publisher that is no longer alive."""
    qos = QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=0.3),
    )
    with node() as made, spinner(made) as spin:
        told: list[Any] = []
        made.create_subscription(
            Int32, "topic", print, qos, event_callbacks=SubscriptionEventCallbacks(liveliness=told.append)
        )
        publisher = made.create_publisher(Int32, "topic", qos)
        publisher.assert_liveliness()
        spin(lambda: len(told) == 2)
        for event in told:
            print(
                event.alive_count,
                event.alive_count_change,
                event.not_alive_count,
                event.not_alive_count_change,
            )


def incompatible_type() -> None:
    """Two types on one topic."""
    with node() as made, spinner(made) as spin:
        publisher = tell("publisher", lambda: bool(made.create_publisher(Int32, "topic", 10)))
        tell("subscription", lambda: bool(made.create_subscription(String, "topic", print, 10)))
        spin(seconds=QUIET_S)
        print(publisher, made.count_publishers("topic"), made.count_subscribers("topic"))


def message_lost() -> None:
    """A depth of 1 keeps the last sample."""
    with node() as made, spinner(made) as spin:
        received: list[int] = []
        publisher = made.create_publisher(Int32, "topic", 10)
        made.create_subscription(Int32, "topic", lambda m: received.append(m.data), 1)
        wait(lambda: publisher.get_subscription_count())
        for number in range(5):
            publisher.publish(Int32(data=number))
        wait(lambda: False, 0.1)
        spin(lambda: received)
        spin(seconds=QUIET_S)
        print(received)


def _check(offered: Any, requested: Any) -> str:
    result, reason = qos_check_compatible(offered, requested)
    return f"{result.name} {reason}"


def check_reliability_durability() -> None:
    """The matrix of these two policies."""
    for values in product(ReliabilityPolicy, DurabilityPolicy, ReliabilityPolicy, DurabilityPolicy):
        names = [each.name for each in values]
        profiles = [
            QoSProfile(depth=1, reliability=values[side], durability=values[side + 1]) for side in (0, 2)
        ]
        print(*names, _check(*profiles))


def check_liveliness() -> None:
    """The matrix of kinds and leases."""
    for values in product(LivelinessPolicy, SPANS_S, LivelinessPolicy, SPANS_S):
        profiles = [
            QoSProfile(
                depth=1,
                liveliness=values[side],
                liveliness_lease_duration=Duration(seconds=values[side + 1]),
            )
            for side in (0, 2)
        ]
        print(values[0].name, values[1], values[2].name, values[3], _check(*profiles))


def check_deadlines() -> None:
    """The matrix of deadlines."""
    for offered, requested in product((*SPANS_S, Infinite), repeat=2):
        spans = [
            each if isinstance(each, Duration) else Duration(seconds=each) for each in (offered, requested)
        ]
        print(*spans, _check(*(QoSProfile(depth=1, deadline=each) for each in spans)))


def check_history() -> None:
    """History and depth are not compared."""
    for left, right in product((HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL), repeat=2):
        print(
            left.name,
            right.name,
            _check(QoSProfile(history=left, depth=1), QoSProfile(history=right, depth=5)),
        )


def _matched(values: tuple[Any, ...]) -> QoSProfile:
    return QoSProfile(
        depth=1,
        reliability=values[0],
        durability=values[1],
        deadline=Duration(seconds=values[2]),
        liveliness=values[3],
        liveliness_lease_duration=Duration(seconds=values[4]),
    )


def endpoints_matrix() -> None:
    """All 1,024 pairs of 32 profiles, with real endpoints: the publishers that each subscription matches."""
    choices = [_matched(each) for each in product(RELIABILITY, DURABILITY, (0, 60), LIVELINESS, (0, 60))]
    with node() as made:
        publishers = [made.create_publisher(Int32, "topic", each) for each in choices]

        def matched() -> list[int]:
            return [number for number, each in enumerate(publishers) if each.get_subscription_count()]

        for number, choice in enumerate(choices):
            expected = [
                i for i, each in enumerate(choices)
                if qos_check_compatible(each, choice)[0] != QoSCompatibility.ERROR
            ]  # fmt: skip
            subscription = made.create_subscription(Int32, "topic", print, choice)
            wait(lambda e=expected: matched() == e)
            wait(lambda: False, 0.1)
            print(number, matched())
            made.destroy_subscription(subscription)
            wait(lambda: not matched())


def profile_repr() -> None:
    """Profiles as text."""
    print(QoSProfile(depth=3))
    print(QoSProfile(history=HistoryPolicy.KEEP_ALL, deadline=Duration(seconds=1), lifespan=Infinite))
    for preset in QoSPresetProfiles:
        print(preset.name, preset.value)


def profile_arguments() -> None:
    """Arguments of a profile."""
    warnings.simplefilter("ignore")
    for options in (
        {},
        {"history": HistoryPolicy.KEEP_LAST},
        {"history": HistoryPolicy.KEEP_ALL},
        {"depth": "1"},
        {"depth": 1, "reliability": 1},
        {"depth": 1, "reliability": 9},
        {"depth": 1, "reliability": "reliable"},
        {"depth": 1, "deadline": 1},
        {"depth": -1},
        {"depth": 0},
        {"depth": 1, "other": 1},
        {"depth": 1, "avoid_ros_namespace_conventions": 1},
    ):
        tell(options, lambda o=options: str(QoSProfile(**o)))


def profile_equality() -> None:
    """Comparison, hash and dictionaries."""
    print(QoSProfile(depth=1) == QoSProfile(depth=1), QoSProfile(depth=1) == QoSProfile(depth=2))
    print(QoSProfile(depth=1) == 1)
    tell("hash", lambda: hash(QoSProfile(depth=1)) and None)


def short_keys() -> None:
    """Names as people type them."""
    for policy in (HistoryPolicy, ReliabilityPolicy, DurabilityPolicy, LivelinessPolicy):
        print(policy.__name__, policy.short_keys())
        tell("reliable", policy.get_from_short_key, "reliable")
        tell("unknown", policy.get_from_short_key, "UNKNOWN")
    print(QoSPresetProfiles.short_keys())
    print(ReliabilityPolicy.BEST_EFFORT.short_key)


def deprecated_names() -> None:
    """Names from before Foxy warn."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        print(repr(ReliabilityPolicy.RMW_QOS_POLICY_RELIABILITY_RELIABLE))
        print(repr(HistoryPolicy.RMW_QOS_POLICY_HISTORY_KEEP_LAST))
        for each in caught:
            print(each.category.__name__, each.message)


def create_with_depth() -> None:
    """A number is a depth."""
    with node() as made:
        print(made.create_publisher(Int32, "topic", 7).qos_profile)
        for wrong in (-1, "10", 1.5, None, True):
            tell(wrong, lambda w=wrong: bool(made.create_publisher(Int32, "topic", w)))


def overriding_options() -> None:
    """Parameters that override a profile."""
    from rclpy.qos_overriding_options import QoSOverridingOptions

    with node(args=["--ros-args", "-p", "qos_overrides./topic.publisher.depth:=3"]) as made:
        options = QoSOverridingOptions.with_default_policies()
        publisher = made.create_publisher(Int32, "topic", 10, qos_overriding_options=options)
        print(publisher.qos_profile.depth)
        for name in sorted(made.get_parameters_by_prefix("qos_overrides")):
            print(name, made.get_parameter(f"qos_overrides.{name}").value)


def overriding_with_validation() -> None:
    """A callback may reject an overridden profile."""
    from rclpy.qos_overriding_options import QosCallbackResult, QoSOverridingOptions

    with node() as made:
        rejected = QosCallbackResult()
        rejected.successful = False
        rejected.reason = "no"
        options = QoSOverridingOptions.with_default_policies(callback=lambda _: rejected)
        tell("rejected", made.create_publisher, Int32, "topic", 10, qos_overriding_options=options)


def lifespan_expires() -> None:
    """Samples older than their lifespan are not delivered."""
    qos = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=0.2))
    with node() as made, spinner(made) as spin:
        received: list[int] = []
        publisher = made.create_publisher(Int32, "topic", qos)
        publisher.publish(Int32(data=1))
        wait(lambda: False, 0.5)
        publisher.publish(Int32(data=2))
        made.create_subscription(Int32, "topic", lambda m: received.append(m.data), qos)
        spin(lambda: received)
        spin(seconds=QUIET_S)
        print(received)
