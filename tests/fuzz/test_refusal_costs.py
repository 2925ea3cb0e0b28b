"""Calls that a refusal makes, beside those of an accepted message, and the search for the dearest."""

from __future__ import annotations

import json
import random
from itertools import islice
from typing import Any, Final

import pytest

from tests.fuzz.refusal_costs import (
    MAX_BYTES,
    TARGETS,
    FoxgloveTarget,
    InMemory,
    RosbridgeTarget,
    messages,
    mutated,
)

FLOOD: Final = 150
"""Refusals before one is counted: more than a client's burst of log lines."""

ACCEPTED: Final = b'{"op":"call_service","service":"/svc","id":"1","args":{"data":true}}'

DEARER: Final = {
    '"std_msgs/Strin"': 1700,  # Similar names are searched for.
    '"qos"': 300,  # Members of members are named.
    '"getParameters"': 550,  # Two calls of a service, one of which is accepted.
    '"publis"': 240,  # Similar ops, and the list of all.
}
"""Maximum number of calls of refusals that cost more than an accepted call, by a part of the message."""


def _messages(kind: type[InMemory]) -> list[Any]:
    return [pytest.param(kind, each, id=json.dumps(each)[:80]) for each in kind.seeds]


@pytest.mark.parametrize(("kind", "message"), _messages(RosbridgeTarget) + _messages(FoxgloveTarget))
def test_a_refusal_costs_no_more_than_an_acceptance(kind: type[InMemory], message: dict[str, Any]) -> None:
    target, data = kind(), json.dumps(message).encode()
    for _ in range(FLOOD):
        target.calls(data)
    calls = target.calls(data)
    accepted = RosbridgeTarget()
    for _ in range(3):  # The first fill caches.
        bound = accepted.calls(ACCEPTED)
    listed = [most for part, most in DEARER.items() if part in data.decode()]
    assert calls <= max([1.1 * bound, *listed])


def test_the_lines_of_a_flood_are_not_formatted() -> None:
    target, data = RosbridgeTarget(), json.dumps(RosbridgeTarget.seeds[0]).encode()
    first = target.calls(data)
    for _ in range(FLOOD):
        target.calls(data)
    # The least of some: a line is due each second.
    assert min(target.calls(data) for _ in range(5)) < 0.6 * first


@pytest.mark.parametrize("name", ["rosbridge", "foxglove"])
def test_every_kind_of_message_is_searched(name: str) -> None:
    target = TARGETS[name]()
    found = [target.cost(message, data) for message, data in islice(messages(7, target, []), 400)]
    target.close()
    refused = [each for each in found if each is not None]
    assert len(refused) > 100
    assert all(len(each.data) <= MAX_BYTES for each in refused)


def test_the_same_seed_gives_the_same_mutations() -> None:
    one, other, third = (random.Random(seed) for seed in (7, 7, 8))
    seeds = RosbridgeTarget.seeds
    assert (
        [mutated(one, each, seeds[0]) for each in seeds]
        == [mutated(other, each, seeds[0]) for each in seeds]
        != [mutated(third, each, seeds[0]) for each in seeds]
    )
