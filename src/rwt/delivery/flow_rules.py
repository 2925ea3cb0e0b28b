"""Default flow rules of a topic, for slow clients that request none."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rwt_participant.qos import History, Reliability
from rwt_transports.endpoint import AS_MANY_AS_FIT, FlowRules

if TYPE_CHECKING:
    from rwt_graph.api import EndpointInfo


def rules_as_published(publishers: Iterable[EndpointInfo]) -> FlowRules:
    """Return the queue rules of a topic: sensor streams keep the newest, others what fits (SUB-17)."""
    offers = [each.qos for each in publishers]
    lossy = [
        qos
        for qos in offers
        if qos.reliability is Reliability.BEST_EFFORT and qos.history is History.KEEP_LAST
    ]
    if offers and len(lossy) == len(offers):
        return FlowRules(max(1, *(qos.depth for qos in lossy)))
    return AS_MANY_AS_FIT
