"""Table of decisions: what each gateway may do with each kind of resource, and what is checked.

:class:`rwt.access.client_graph.ClientGraph` looks up every verb here: what has no row is rejected.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.access.roles import Act

VERBS: Final[Mapping[str, Act]] = {
    "advertise": "publish",
    "publisher": "publish",
    "subscribe": "subscribe",
    "call_service": "call",
    "advertise_service": "provide",
    "send_goal": "goals",
    "cancel_goal": "goals",
    "advertise_action": "provide",
}
"""Permission that the role needs, by verb: name of a method of :class:`rwt.access.client_graph.ClientGraph`.

Parameters are set through services, which declare it (:mod:`rwt_graph.disclosure`).
"""

READS: Final = ("subscribe", "call_service")
"""Verbs of clients that read."""

#: Decisions by gateway.
_GATEWAYS: Final[dict[str, Mapping[str, Act]]] = {}


def declare(gateway: str, *verbs: str) -> None:
    """Declare the verbs of a gateway; one of an extension does so before its first client connects.

    Args:
        gateway: name of the gateway, with which the names of its clients begin.
        verbs: names of :data:`VERBS`.

    Raises:
        ValueError: a verb is unknown, or the gateway has declared others.
    """
    unknown = sorted(set(verbs) - set(VERBS))
    if unknown:
        raise ValueError(f"{gateway}: unknown verbs {', '.join(unknown)}")
    decisions = {verb: VERBS[verb] for verb in verbs}
    if _GATEWAYS.setdefault(gateway, decisions) != decisions:
        raise ValueError(f"{gateway}: declared before, with other verbs")


def gateways() -> tuple[str, ...]:
    """Return the names of the gateways with declared verbs."""
    return tuple(_GATEWAYS)


def decisions_of(client: str) -> Mapping[str, Act]:
    """Return the verbs of a client: those of its gateway, none for one that is not declared.

    Args:
        client: name of the client, such as `http:3`; empty for a program in this process, for which all are.
    """
    return _GATEWAYS.get(client.partition(":")[0], {}) if client else VERBS
