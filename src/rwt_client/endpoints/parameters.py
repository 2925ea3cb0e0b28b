"""Parameters of the robot's nodes, through rosapi."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rwt_program import api
from rwt_program.errors import NotFound, ParameterRejected, RobotError, ServiceFailed
from rwt_program.messages import ParameterValue

if TYPE_CHECKING:
    from rwt_client.rosapi import Ask


class Parameters(api.Parameters):
    """The parameters of a robot: ``/demo_robot:max_speed`` on ROS 2, ``/max_speed`` on ROS 1."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:  # noqa: D102 - inherited
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

    async def set(self, name: str, value: ParameterValue) -> None:  # noqa: D102 - inherited
        await self._asked("set_param", ParameterRejected, name=name, value=json.dumps(value))

    async def has(self, name: str) -> bool:  # noqa: D102 - inherited
        return bool((await self._asked("has_param", name=name)).get("exists"))

    async def delete(self, name: str) -> None:  # noqa: D102 - inherited
        try:
            await self._asked("delete_param", ParameterRejected, name=name)
        except ParameterRejected as error:
            if await self.has(name):
                raise
            raise NotFound(str(error)) from None

    async def names(self) -> tuple[str, ...]:  # noqa: D102 - inherited
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
