"""Parameters of the robot's nodes, through rosapi."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from rwt_client.errors import CallFailed, ParameterRefused

Ask = Callable[[str, Mapping[str, object]], Awaitable[Any]]
"""Calls a service of rosapi with plain arguments; gives its plain answer. Raises CallFailed and NoAnswer."""

ParameterValue = bool | int | float | str | list[Any] | dict[str, Any] | None


class Parameters:
    """The parameters of a robot.

    A name is ``/node:name`` on ROS 2, for example ``/demo_robot:max_speed``, and ``/name`` on ROS 1 (API-08).
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:
        """The value of a parameter.

        Args:
            default: what to return when there is no such parameter; None raises instead.

        Raises:
            ParameterRefused: there is none, and there is no default.
        """
        try:
            answer = await self._asked("get_param", name=name)
        except ParameterRefused:
            if default is not None:
                return default
            raise
        value: ParameterValue = json.loads(answer.get("value") or "null")
        if value is None and default is None:
            raise ParameterRefused(f"there is no parameter {name}")
        return default if value is None else value

    async def set(self, name: str, value: ParameterValue) -> None:
        """Give a parameter a value; returns once the node has taken it.

        Raises:
            ParameterRefused: the node does not take it, or there is none of that name; the server's text.
        """
        await self._asked("set_param", name=name, value=json.dumps(value))

    async def has(self, name: str) -> bool:
        """Whether there is such a parameter."""
        return bool((await self._asked("has_param", name=name)).get("exists"))

    async def delete(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            ParameterRefused: it cannot be removed.
        """
        await self._asked("delete_param", name=name)

    async def names(self) -> tuple[str, ...]:
        """The names of all parameters."""
        return tuple(map(str, (await self._asked("get_param_names")).get("names", ())))

    async def _asked(self, question: str, **args: object) -> dict[str, Any]:
        try:
            answer = await self._ask(question, args)
        except CallFailed as error:
            raise ParameterRefused(str(error)) from None
        found: dict[str, Any] = answer if isinstance(answer, dict) else {}
        if found.get("successful") is False:
            name = args.get("name", "")
            raise ParameterRefused(str(found.get("reason") or f"{question} of {name} was refused"))
        return found
