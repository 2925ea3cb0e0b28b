"""Parameters of a robot through the services of rosapi, for clients and for views of a role."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, TypeAlias

import anyio

from rwt_participant.api import Parameters
from rwt_participant.errors import (
    CallTimeout,
    NotFound,
    ParameterRejected,
    ProviderNotFound,
    RobotError,
    ServiceFailed,
)
from rwt_participant.messages import ParameterValue
from rwt_participant.spelling import did_you_mean

#: Calls a service of rosapi by the last part of its name, with plain arguments; returns the plain response.
#: Raises CallFailed.
Ask: TypeAlias = Callable[[str, Mapping[str, object]], Awaitable[Any]]

UNANSWERED: Final = (ServiceFailed, ProviderNotFound, CallTimeout)
"""Errors of a request that the robot does not answer although it is connected."""

ADVICE_SECONDS: Final = 1.0
"""Maximum delay of an error in seconds, to ask for names to suggest."""


class RosapiParameters(Parameters):
    """Parameters of all nodes: ``/demo_robot:max_speed`` on ROS 2, ``/max_speed`` on ROS 1."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    async def get(self, name: str, default: ParameterValue = None) -> ParameterValue:
        try:
            answer = await self._asked("get_param", NotFound, name=name)
        except NotFound as error:
            if default is not None:
                return default
            if isinstance(error, ProviderNotFound):
                raise  # There is no rosapi to ask.
            raise await self._not_found(name, str(error)) from None
        try:
            value: ParameterValue = json.loads(answer.get("value") or "null")
        except (ValueError, TypeError, RecursionError):
            raise ServiceFailed(f"the value of {name} is not JSON") from None
        if value is None and default is None:
            raise await self._not_found(name, f"there is no parameter {name}")
        return default if value is None else value

    async def set(self, name: str, value: ParameterValue) -> None:
        try:
            await self._asked("set_param", ParameterRejected, name=name, value=json.dumps(value))
        except ParameterRejected as error:
            raise ParameterRejected(f"{error}{await self._meant(name)}") from None

    async def has(self, name: str) -> bool:
        return bool((await self._asked("has_param", name=name)).get("exists"))

    async def delete(self, name: str) -> None:
        try:
            await self._asked("delete_param", ParameterRejected, name=name)
        except ParameterRejected as error:
            if await self.has(name):
                raise
            raise await self._not_found(name, str(error)) from None

    async def _not_found(self, name: str, text: str) -> NotFound:
        return NotFound(f"{text}{await self._meant(name)}")

    async def _meant(self, name: str) -> str:
        with anyio.move_on_after(ADVICE_SECONDS):
            try:
                return did_you_mean(name, await self.names())
            except UNANSWERED:
                pass  # The suggestion is optional.
        return ""

    async def names(self) -> tuple[str, ...]:
        names = (await self._asked("get_param_names")).get("names")
        return tuple(map(str, names)) if isinstance(names, list) else ()

    async def _asked(
        self, question: str, refused: type[RobotError] = ServiceFailed, **args: object
    ) -> dict[str, Any]:
        try:
            answer = await self._ask(question, args)
        except ServiceFailed as error:
            raise refused(str(error)) from None
        found: dict[str, Any] = answer if isinstance(answer, dict) else {}
        if found.get("successful") is False:
            name = args.get("name", "")
            raise refused(str(found.get("reason") or f"{question} of {name} was refused"))
        return found
