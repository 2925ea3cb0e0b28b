"""Parameters of the robot's nodes, through rosapi."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rwt_program.errors import NotFound, ParameterRejected, RobotError, ServiceFailed
from rwt_program.messages import ParameterValue

if TYPE_CHECKING:
    from rwt_client.rosapi import Ask


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
            NotFound: there is none, and there is no default.
            CallFailed: the robot does not tell.
        """
        try:
            answer = await self._asked("get_param", NotFound, name=name)
        except NotFound:
            if default is not None:
                return default
            raise
        value: ParameterValue = json.loads(answer.get("value") or "null")
        if value is None and default is None:
            raise NotFound(f"there is no parameter {name}")
        return default if value is None else value

    async def set(self, name: str, value: ParameterValue) -> None:
        """Give a parameter a value; returns once the node has taken it.

        Raises:
            ParameterRejected: the node does not take it, or there is none of that name; says why.
            CallFailed: the robot does not tell.
        """
        await self._asked("set_param", ParameterRejected, name=name, value=json.dumps(value))

    async def has(self, name: str) -> bool:
        """Whether there is such a parameter. Raises :exc:`CallFailed`."""
        return bool((await self._asked("has_param", name=name)).get("exists"))

    async def delete(self, name: str) -> None:
        """Remove a parameter.

        Raises:
            ParameterRejected: it cannot be removed.
            NotFound: there is none of that name.
            CallFailed: the robot does not tell.
        """
        try:
            await self._asked("delete_param", ParameterRejected, name=name)
        except ParameterRejected as error:
            if await self.has(name):
                raise
            raise NotFound(str(error)) from None

    async def names(self) -> tuple[str, ...]:
        """The names of all parameters. Raises :exc:`CallFailed`."""
        return tuple(map(str, (await self._asked("get_param_names")).get("names", ())))

    async def _asked(
        self, question: str, refused: type[RobotError] = ServiceFailed, **args: object
    ) -> dict[str, Any]:
        """The answer, or `refused` with the robot's words."""
        try:
            answer = await self._ask(question, args)
        except ServiceFailed as error:
            raise refused(str(error)) from None
        found: dict[str, Any] = answer if isinstance(answer, dict) else {}
        if found.get("successful") is False:
            name = args.get("name", "")
            raise refused(str(found.get("reason") or f"{question} of {name} was refused"))
        return found
