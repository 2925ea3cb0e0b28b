"""Reachability of the nodes that a master lists, for `rwt doctor`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import anyio

from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.declarations import Finding
from rwt.extensions.ros1.discovery import State
from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.addresses import is_loopback, master_uri, own_address
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


async def examine(url: str, report: Callable[[Finding], None]) -> None:
    """Examine the nodes of a master, for `rwt doctor`. Raises CommandError for an invalid URL."""
    try:
        master = master_uri(url)
    except Ros1Error as error:
        raise CommandError(str(error), CALLED_WRONGLY) from error
    try:
        nodes = await examine_nodes(master)
    except Ros1Error as error:
        report(Finding("connection", "problem", str(error), "start `roscore`, and compare host and port"))
        return
    report(Finding("connection", "ok", f"the master at {master} answers and lists {len(nodes)} nodes"))
    address = own_address(master)
    text = f"the robot's nodes are told to connect to this machine at {address.host}, {address.source}"
    report(Finding("address", "note", text, "set ROS_IP if that is not an address the robot reaches"))
    for node in nodes:
        if node.problem is None:
            report(Finding("node", "ok", f"{node.name} answers"))
            continue
        host = node.uri.removeprefix("http://").partition(":")[0]
        why, advice = {
            "unresolved": (
                f"its host name {host} does not resolve here: topics are listed, and nothing is received",
                f"add the address of {host} to /etc/hosts here, or start the node with ROS_IP set to it",
            ),
            "loopback": (
                f"it registered {host}, which is this machine and not the robot",
                "start the node with ROS_IP set to the robot's address in this network",
            ),
            "silent": (
                "it does not answer",
                "remove it with `rosnode cleanup` if it has crashed; otherwise look for a firewall",
            ),
        }[node.problem]
        report(Finding("node", "problem", f"{node.name} ({node.uri}) cannot be reached: {why}", advice))
