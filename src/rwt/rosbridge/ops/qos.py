"""Translation of a client's `qos` object into the graph's policies and the rules of its queue."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rwt.delivery.throttle import rules_as_published
from rwt_graph.api import EndpointInfo
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.qos import LATCHED, SENSOR_DATA, Durability, History, QoS, Reliability
from rwt_protocol import ops
from rwt_protocol.ops.light import LightPublish
from rwt_protocol.ops.topics import Qos
from rwt_transports.endpoint import AS_MANY_AS_FIT, FlowRules

_DEFAULT = QoS()


def publisher_qos(op: ops.Advertise | ops.Publish | LightPublish) -> QoS | None:
    """Return the QoS of a new publisher: `qos` over `latch` over the graph's default (ADV-07, ADV-11)."""
    if op.qos is None:
        return LATCHED if op.latch else None
    request = op.qos
    return QoS(
        history=_DEFAULT.history if request.history is None else History(request.history),
        depth=request.depth or _DEFAULT.depth,
        reliability=_DEFAULT.reliability if request.reliability is None else Reliability(request.reliability),
        durability=_DEFAULT.durability if request.durability is None else Durability(request.durability),
        deadline=_seconds(request.deadline),
        lifespan=_seconds(request.lifespan),
    )


def incompatible_policies(request: Qos, offered: QoS) -> str:
    """Return the requested policies that a publisher does not offer, as text; empty if none (ADV-11).

    A policy that is missing or `best_available` is always compatible.
    """
    pairs: tuple[tuple[str, object, object], ...] = (
        ("history", request.history, offered.history.value),
        ("depth", request.depth or None, offered.depth),
        ("reliability", request.reliability, offered.reliability.value),
        ("durability", request.durability, offered.durability.value),
        ("deadline", request.deadline, offered.deadline or "infinite"),
        ("lifespan", request.lifespan, offered.lifespan or "infinite"),
    )
    found = [
        f"{name} {has} where {wants or 'infinite'} is asked for"
        for name, wants, has in pairs
        if wants not in (None, "best_available") and (wants or "infinite") != has
    ]
    return ", ".join(found)


def qos_request(
    subscriptions: Sequence[ops.Subscribe], publishers: Iterable[EndpointInfo]
) -> tuple[FlowRules, int, float]:
    """Merge the requests of several subscriptions: each gets at least its request, except for the smallest
    `queue_length` (X06). A client that requests nothing takes what the publishers offer (SUB-17).

    Returns:
        Queue rules, lifespan of samples in nanoseconds (0: none), and deadline in seconds (0: none).
    """
    each = [_rules(op) for op in subscriptions]
    said = [rules for rules in each if rules is not None]
    rules = _together(said) if len(said) == len(each) else rules_as_published(publishers)
    lifespans = [_seconds(op.qos.lifespan if op.qos else None) or 0.0 for op in subscriptions]
    deadlines = [_seconds(op.qos.deadline if op.qos else None) or 0.0 for op in subscriptions]
    lifespan_ns = 0 if 0.0 in lifespans else round(max(lifespans) * NANOSECONDS)
    return rules, lifespan_ns, min((seconds for seconds in deadlines if seconds), default=0.0)


def history_depth(op: ops.Subscribe) -> int | None:
    """Return how many retained samples a new subscription gets: None for all of them, 0 for none."""
    if op.qos is None:
        return None
    if op.qos.durability == "volatile":
        return 0
    return None if op.qos.history == "keep_all" else op.qos.depth or None


def _rules(op: ops.Subscribe) -> FlowRules | None:
    """Return the queue rules of one subscription: `qos` over `queue_length`; None if it asks for neither."""
    request = op.qos
    if request is not None:
        if request.history == "keep_all":
            return FlowRules(keep_all=request.reliability != "best_effort")
        if request.depth:
            return FlowRules(request.depth)
        if request.reliability == "best_effort":
            return FlowRules(op.queue_length or SENSOR_DATA.depth)
    if op.queue_length:
        return FlowRules(op.queue_length)
    if request is not None and request.reliability == "reliable":
        return AS_MANY_AS_FIT
    return None


def _together(rules: Sequence[FlowRules]) -> FlowRules:
    depths = [each.depth for each in rules]
    known = [depth for depth in depths if depth is not None]
    return FlowRules(max(known) if len(known) == len(depths) else None, any(each.keep_all for each in rules))


def _seconds(request: float | str | None) -> float | None:
    """Return seconds; None without a limit: nothing, zero, "infinite" or "best_available"."""
    return None if isinstance(request, str) else request or None
