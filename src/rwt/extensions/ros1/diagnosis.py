"""Reachability of the nodes that a master lists, for `rwt doctor`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import anyio

from rwt.extensions.ros1.discovery import State
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.addresses import is_loopback
from rwt_graph.errors import Ros1Error, WireError

_MOST_AT_ONCE: Final = 16


@dataclass(frozen=True, slots=True)
class NodeReport:
    """Node as this machine reaches it.

    Attributes:
        uri: address that it has registered.
        problem: "unresolved" if its host name has no address here, "loopback" if it names this machine
            although the master is on another, "silent" if it does not answer; None if it answers.
    """

    name: str
    uri: str
    problem: Literal["unresolved", "loopback", "silent"] | None = None


async def examine_nodes(master: str) -> list[NodeReport]:
    """Return a report of every node of a master.

    Raises:
        Ros1Error: the master does not answer.
    """
    state = await State.of(await rpc.call(master, "getSystemState", "/rwt_doctor"))
    is_local = is_loopback(rpc.address_of(master)[0])
    names = {node for _, node, _ in state.endpoints()}.union(*state.services.values())
    reports: list[NodeReport] = []
    limiter = anyio.CapacityLimiter(_MOST_AT_ONCE)

    async def examine(name: str) -> None:
        async with limiter:
            reports.append(await _report(master, name, is_local=is_local))

    async with anyio.create_task_group() as group:
        for name in names:
            group.start_soon(examine, name)
    return sorted(reports, key=lambda each: each.name)


async def _report(master: str, name: str, *, is_local: bool) -> NodeReport:
    uri = ""
    try:
        uri = str(await rpc.call(master, "lookupNode", "/rwt_doctor", name))
        host, port = rpc.address_of(uri)
        try:
            await anyio.getaddrinfo(host, port)
        except OSError:
            return NodeReport(name, uri, "unresolved")
        if is_loopback(host) and not is_local:
            return NodeReport(name, uri, "loopback")
        await rpc.call(uri, "getPid", "/rwt_doctor")
    except (Ros1Error, WireError):
        return NodeReport(name, uri, "silent")
    return NodeReport(name, uri)
