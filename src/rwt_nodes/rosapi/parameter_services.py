"""Parameters, with their values as JSON text both ways (API-07)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rwt_graph.errors import GraphError, ServiceFailed

if TYPE_CHECKING:
    from rwt_graph.program.node import Node

Answer = dict[str, object]

_DESCRIPTION = "robot_description"


class ParameterServices:
    """Handlers of the parameter services. Names are `/node:name` on ROS 2 and `/name` on ROS 1 (API-08).

    On ROS 2 a failure is told in `successful` and `reason`; ROS 1's types lack them, so it fails the call.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._reports = node.distro.rosapi_reports_failures

    async def get_param_names(self, _: Any) -> Answer:
        """The names of all parameters."""
        return {"names": sorted(await self._node.list_params())}

    async def get_param(self, request: Any) -> Answer:
        """One value; if there is none, the request's default, and without that null (API-07)."""
        default = request.default_value if self._reports else request.default
        try:
            value = await self._node.get_param(await self._full_name(request.name))
        except GraphError as error:
            if default or not self._reports:
                return {"value": default or "null", **self._done()}
            return {"value": "null", "successful": False, "reason": str(error)}
        return {"value": json.dumps(value), **self._done()}

    async def _full_name(self, name: str) -> str:
        """Where the robot's description is on ROS 2: what viewers ask for has the name that it had on ROS 1.

        Nothing is guessed where several nodes of that namespace have one, or none has.
        """
        above, _, last = name.rpartition("/")
        in_nodes = self._node.distro.parameters_belong_to_nodes
        if not in_nodes or last != _DESCRIPTION or await self._node.has_param(name):
            return name
        found = [
            known
            for known in await self._node.list_params()
            if known.startswith(f"{above}/") and known.endswith(f":{_DESCRIPTION}")
        ]
        return found[0] if len(found) == 1 else name

    async def set_param(self, request: Any) -> Answer:
        """Set one value from JSON text."""
        try:
            value = json.loads(request.value)
        except (ValueError, RecursionError):
            return self._failed(f"set_param: value of {request.name} is not JSON: {request.value[:80]!r}")
        try:
            await self._node.set_param(request.name, value)
        except GraphError as error:
            return self._failed(str(error))
        return self._done()

    async def has_param(self, request: Any) -> Answer:
        """Whether a parameter is there."""
        try:
            return {"exists": await self._node.has_param(request.name)}
        except GraphError:
            return {"exists": False}

    async def delete_param(self, request: Any) -> Answer:
        """Remove one parameter."""
        try:
            await self._node.delete_param(request.name)
        except GraphError as error:
            return self._failed(str(error))
        return self._done()

    async def search_param(self, request: Any) -> Answer:
        """The full name of the first parameter whose last part is the one asked for; empty if none is."""
        wanted = request.name.strip("/")
        for name in sorted(await self._node.list_params()):
            if wanted in (name.rpartition(":")[2], name.strip("/"), name.rpartition("/")[2]):
                return {"global_name": name}
        return {"global_name": ""}

    def _done(self) -> Answer:
        return {"successful": True, "reason": ""} if self._reports else {}

    def _failed(self, reason: str) -> Answer:
        if self._reports:
            return {"successful": False, "reason": reason}
        raise ServiceFailed(reason)
