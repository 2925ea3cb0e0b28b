"""Parameters of any node, by full name.

Names work for ROS 1 and ROS 2: `/node:param` is a node's parameter, on ROS 1 `/node/param` of the global
tree; a name without a colon is in the global tree. The tree also exists on ROS 2, separate from the nodes'
parameters, for programs written for ROS 1.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import TypeAlias, TypeVar

from rwt_graph.api import Graph
from rwt_graph.names import resolve, split_parameter
from rwt_graph.parameters.values import decode, encode
from rwt_participant.api import Parameters
from rwt_participant.errors import CallFailed, NotFound, ParameterRejected, ProviderNotFound
from rwt_participant.future import run_until_it_waits
from rwt_participant.messages import Message, MessageLike, ParameterValue

logger = logging.getLogger(__name__)

T = TypeVar("T")

#: Timeout of a node's answer about its parameters, in seconds.
ANSWER_TIMEOUT = 5.0

#: Verb `call` of a robot.
Call: TypeAlias = Callable[..., Awaitable[Message]]

_LIST = "/list_parameters"


class ParameterClient(Parameters):
    """Client that accesses parameters through `call_service` and the graph's tree."""

    def __init__(self, graph: Graph, namespace: str, node: str, call: Call) -> None:
        self._graph = graph
        self._namespace = namespace
        self._node = node
        self._call = call

    def _place(self, name: str) -> tuple[str, str]:
        split = split_parameter(name)
        if split is None:
            return "", resolve(name, self._namespace, self._node) if name.strip("/") else "/"
        if not self._graph.distro.parameters_belong_to_nodes:
            return "", f"{split[0]}/{split[1]}"
        return split

    async def _ask(self, node: str, service: str, request: MessageLike) -> Message:
        name = f"{node}/{service}"
        # Looked up first: the call would search for similar names, and clients choose these.
        if self._graph.service(name) is not None:
            with suppress(ProviderNotFound):
                return await self._call(name, request, timeout=ANSWER_TIMEOUT)
        raise NotFound(f"node {node} is not there, or has no parameters")

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:
        try:
            return await self._get(name)
        except NotFound:
            if default is None:
                raise
            return default

    async def read(self, name: str, read: Callable[[ParameterValue], T]) -> T:
        """Return the result of a function of a parameter's value; raises as :meth:`get`.

        The value is not copied, because the tree may be large: the function must not change or keep it.
        """
        node, parameter = self._place(name)
        if not node:
            return self._graph.parameters.read(parameter, read)
        return read(await self._get(name))

    async def _get(self, name: str) -> ParameterValue:
        node, parameter = self._place(name)
        if not node:
            return self._graph.parameters.get(parameter)
        response = await self._ask(node, "get_parameters", {"names": [parameter]})
        value = decode(response.values[0]) if response.values else None
        if value is None:
            raise NotFound(f"parameter {parameter} of node {node} is not set")
        return value

    async def set(self, name: str, value: ParameterValue) -> None:
        node, parameter = self._place(name)
        if not node:
            self._graph.parameters.set(parameter, value)
            return
        try:
            await self._set_remote(node, parameter, encode(value))
        except NotFound as error:
            raise ParameterRejected(str(error)) from None

    async def _set_remote(self, node: str, parameter: str, value: dict[str, object]) -> None:
        request = {"parameters": [{"name": parameter, "value": value}]}
        response = await self._ask(node, "set_parameters", request)
        if response.results and not response.results[0].successful:
            raise ParameterRejected(response.results[0].reason)

    async def delete(self, name: str) -> None:
        node, parameter = self._place(name)
        if not node:
            self._graph.parameters.delete(parameter)
        elif not await self.has(name):
            raise NotFound(f"parameter {parameter} of node {node} is not set")
        else:
            await self._set_remote(node, parameter, encode(None))

    async def has(self, name: str) -> bool:
        node, parameter = self._place(name)
        if not node:
            return self._graph.parameters.has(parameter)
        try:
            await self._get(name)
        except NotFound:
            return False
        return True

    async def names(self) -> tuple[str, ...]:
        found = list(self._graph.parameters.names())

        async def ask(service: str) -> None:
            node = service.removesuffix(_LIST)
            try:
                response = await self._call(service, {}, timeout=ANSWER_TIMEOUT)
            except CallFailed as error:
                logger.warning("the parameters of node %s are not listed: %s", node, error)
            else:
                found.extend(f"{node}:{name}" for name in response.result.names)

        # All calls are sent before the first response is awaited: silent nodes together cost one timeout.
        # No task group: rosapi answers without a task while all nodes are in this process.
        calls = [
            run_until_it_waits(ask(service.name))
            for service in self._graph.services()
            if service.name.endswith(_LIST) and service.type.name == "rcl_interfaces/ListParameters"
        ]
        for each in calls:
            if each is not None:
                await each
        return tuple(sorted(found))
