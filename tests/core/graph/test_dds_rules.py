"""A graph that follows DDS's rules: QoS is matched, and all services of a name are called."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any, Final

import pytest

from rwt_graph import MemoryGraph
from rwt_interfaces.payload import Payload
from rwt_participant.qos import (
    BEST_AVAILABLE,
    LATCHED,
    SENSOR_DATA,
    Durability,
    QoS,
    Reliability,
    incompatible_policies,
)

if TYPE_CHECKING:
    from rwt_graph.api import Sample, ServiceCall

#: Values of each policy, least demanding first: an offer meets every request that is not after it.
POLICIES: Final[dict[str, tuple[Any, ...]]] = {
    "reliability": (Reliability.BEST_EFFORT, Reliability.RELIABLE),
    "durability": (Durability.VOLATILE, Durability.TRANSIENT_LOCAL),
    "deadline": (None, 2.0, 1.0),
    "manual_liveliness": (False, True),
    "lease": (None, 2.0, 1.0),
}


def test_a_pair_is_compatible_if_no_policy_is_exceeded() -> None:
    profiles = list(product(*(range(len(values)) for values in POLICIES.values())))

    def qos(chosen: tuple[int, ...]) -> QoS:
        return QoS(**{name: POLICIES[name][at] for name, at in zip(POLICIES, chosen, strict=True)})

    for offered, requested in product(profiles, repeat=2):
        met = all(asked <= given for given, asked in zip(offered, requested, strict=True))
        assert met == (not incompatible_policies(qos(offered), qos(requested))), (offered, requested)


@pytest.mark.parametrize(
    ("offered", "requested", "dds_rules", "received"),
    [
        (SENSOR_DATA, QoS(), True, 0),
        (SENSOR_DATA, QoS(), False, 3),
        (SENSOR_DATA, BEST_AVAILABLE, True, 3),
        (QoS(), LATCHED, True, 0),
        (LATCHED, LATCHED, True, 3),
    ],
)
def test_samples_reach_compatible_subscriptions(
    offered: QoS, requested: QoS, dds_rules: bool, received: int
) -> None:
    graph = MemoryGraph(dds_rules=dds_rules)
    interface = graph.registry.message("std_msgs/Int32")
    node = graph.participant("/node")
    samples: list[Sample] = []
    publisher = node.advertise("/topic", interface, offered)
    publisher.publish(Payload.from_value(interface, {"data": 1}))
    subscription = node.subscribe("/topic", samples.append, interface, requested)
    for number in (2, 3):
        publisher.publish(Payload.from_value(interface, {"data": number}))
    late = requested.durability is not Durability.VOLATILE and offered.durability is not Durability.VOLATILE
    assert len(samples) == (received if late or not received else 2)
    assert publisher.subscriber_count == bool(received)
    subscription.close()
    assert publisher.subscriber_count == 0


def test_all_services_of_a_name_are_called_and_the_first_response_counts() -> None:
    graph = MemoryGraph(dds_rules=True)
    interface = graph.registry.service("std_srvs/Trigger")
    called: list[str] = []

    def server(name: str) -> Any:
        def on_call(call: ServiceCall) -> None:
            called.append(name)
            call.reply(Payload.from_value(interface.response, {"success": True, "message": name}))

        return on_call

    first, second = graph.participant("/a"), graph.participant("/b")
    first.advertise_service("/service", interface, server("a"))
    second.advertise_service("/service", interface, server("b"))
    replies: list[Any] = []
    first.call_service("/service", Payload.from_value(interface.request, {}), replies.append)
    assert sorted(called) == ["a", "b"] and len(replies) == 1 and graph.count_services("/service") == 2
    second.close()
    assert graph.count_services("/service") == 1
    first.call_service("/service", Payload.from_value(interface.request, {}), replies.append)
    assert called[2:] == ["a"]
