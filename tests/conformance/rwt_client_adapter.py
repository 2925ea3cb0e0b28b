"""Puts `rwt_client` under the conformance suite: `python -m tests.conformance.rwt_client_adapter`."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import sys
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Any

import anyio
import msgspec

from rwt_client import Backoff, ConnectionEvent, Robot, connect
from rwt_participant.errors import (
    CallFailed,
    GoalAborted,
    GoalCanceled,
    NotFound,
    ParameterRejected,
    RobotError,
    ServiceFailed,
)
from rwt_participant.goals import ReceivedGoal
from rwt_protocol.ops import Qos

# Commands and messages, which have no types.
Value = Any

_COMPRESSIONS = ("none", "png", "cbor")


class Unsupported(Exception):
    pass


def say(line: dict[str, Value]) -> None:
    sys.stdout.write(json.dumps(plain(line)) + "\n")
    sys.stdout.flush()


def plain(value: Value) -> Value:
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, bytes | bytearray | memoryview):
        return list(bytes(value))
    if isinstance(value, msgspec.Struct):
        return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
    return None if isinstance(value, float) and not math.isfinite(value) else value


class Complaints(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        cause = f": {record.exc_info[1]!r}" if record.exc_info else ""
        say({"event": "complaint", "text": record.getMessage() + cause})


class Adapter:
    """One method for each command."""

    def __init__(self, say: Callable[[dict[str, Value]], None]) -> None:
        self._say = say
        self._stack = AsyncExitStack()
        self._robot: Robot | None = None
        self._made: dict[str, Value] = {}
        self._restored = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()

    def _event(self, name: str, of: str, **more: Value) -> None:
        self._say({"event": name, "of": of, **more})

    @property
    def robot(self) -> Robot:
        if self._robot is None:
            raise Unsupported("nothing can be asked for before the connection is open")
        return self._robot

    async def connect(self, url: str, wait: bool = True) -> None:
        self._made = {}
        if not wait:
            raise Unsupported("connecting waits for the connection")
        again = Backoff(first=0.05, factor=1.5, longest=0.5)
        opening = connect(url, ros_version=2, fetch_types=False, status_level=None, reconnect=again)
        self._robot = await self._stack.enter_async_context(opening)
        self._robot.on_event(self._on_event)

    def _on_event(self, told: ConnectionEvent) -> None:
        if told.kind == "restored":
            self._restored.set()
        if told.kind == "lost":
            self._restored.clear()
            self._say({"event": "closed"})

    async def reconnect(self, url: str) -> None:
        await self._restored.wait()
        self._restored.clear()

    async def close(self) -> None:
        self._robot = None
        await self._stack.aclose()
        self._restored.clear()

    def _later(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def subscribe(self, topic: str, type: str | None = None, **options: Value) -> None:
        name = options.pop("as")
        if type is None:
            raise Unsupported("without a type, rosapi is asked for it")
        if "queue_length" in options:
            raise Unsupported("no queue_length: the queue is in this program")
        if options.get("compression", "none") not in _COMPRESSIONS:
            raise Unsupported(f"no compression {options['compression']}")
        if "throttle_rate" in options:
            options["throttle"] = options.pop("throttle_rate") / 1000
        if "qos" in options:
            options["qos"] = Qos.model_validate(options["qos"])
        self._made[name] = await self.robot.subscribe(
            topic, lambda message: self._event("message", name, value=message), type, **options
        )

    async def _close_made(self, of: str) -> None:
        self._made[of].close()

    unsubscribe = unadvertise = unadvertise_service = unadvertise_action = _close_made

    async def advertise(self, topic: str, type: str, **options: Value) -> None:
        name = options.pop("as")
        if "qos" in options:
            options["qos"] = Qos.model_validate(options["qos"])
        self._made[name] = await self.robot.advertise(topic, type, **options)

    async def publish(self, msg: Value, of: str = "", topic: str = "", type: str = "") -> None:
        if of:
            self._made[of].publish(msg)
        else:
            await self.robot.publish(topic, msg, type)

    async def call_service(self, service: str, type: str, args: Value = None, **more: Value) -> None:
        name = more.pop("as")
        if more:
            raise Unsupported("its timeout is its own, and calls have no fragment_size")
        self._later(self._answered(name, self.robot.call(service, args, type)))

    async def _answered(self, name: str, call: Awaitable[Value]) -> None:
        try:
            self._event("response", name, value=await call)
        except (CallFailed, NotFound, ParameterRejected) as error:
            self._event("failed", name, error=str(error))

    async def advertise_service(self, service: str, type: str, answer: Value = None, **more: Value) -> None:
        name, said = more["as"], answer or {}

        def handle(request: Value) -> Value:
            self._event("request", name, value=request)
            if "throw" in said:
                raise RuntimeError(said["throw"])
            if said.get("result") is False:
                raise ServiceFailed("as told")
            return said.get("values", {})

        self._made[name] = await self.robot.advertise_service(service, type, handle)

    async def send_goal(self, action: str, type: str, args: Value, **more: Value) -> None:
        if more.get("feedback") is False:
            raise Unsupported("goals always ask for feedback")
        name = more["as"]
        goal = await self.robot.send_goal(
            action, args, type, on_feedback=lambda value: self._event("feedback", name, value=value)
        )
        self._made[name] = goal
        self._later(self._ended(name, goal))

    async def _ended(self, name: str, goal: Value) -> None:
        try:
            end = await goal.result()
            self._event("result", name, value=end.result, status=int(end.status))
        except CallFailed as error:
            self._event("failed", name, error=str(error))
        except RobotError as error:
            self._say({"event": "complaint", "text": str(error)})

    async def cancel_goal(self, of: str) -> None:
        self._made[of].cancel()

    async def advertise_action(self, action: str, type: str, answer: Value = None, **more: Value) -> None:
        name, said = more["as"], answer or {}

        async def execute(goal: ReceivedGoal) -> Value:
            self._event("goal", name, value=goal.request)
            for feedback in said.get("feedback", []):
                goal.publish_feedback(feedback)
            if said.get("end") == "abort":
                raise GoalAborted(said.get("values", {}))
            if said.get("end") == "wait":
                await goal.cancel_event.wait()
                self._event("cancel", name)
                raise GoalCanceled(said.get("values", {}))
            return said.get("values", {})

        self._made[name] = await self.robot.advertise_action(action, type, execute)

    async def get_param(self, name: str, **more: Value) -> None:
        self._later(self._answered(more["as"], self.robot.params.get(name)))

    async def set_param(self, name: str, value: Value, **more: Value) -> None:
        self._later(self._answered(more["as"], self.robot.params.set(name, value)))

    async def delete_param(self, name: str, **more: Value) -> None:
        self._later(self._answered(more["as"], self.robot.params.delete(name)))

    async def ask(self, what: str, of_what: str | None = None, **more: Value) -> None:
        source = self.robot.params.names if what == "params" else getattr(self.robot.api, what)
        self._later(self._asked(more["as"], source, of_what))

    async def _asked(self, name: str, source: Callable[..., Awaitable[Value]], of_what: str | None) -> None:
        async def answer() -> Value:
            value = await source(*([] if of_what is None else [of_what]))
            if isinstance(value, tuple):
                return [item if isinstance(item, str) else _name(item) for item in value]
            return value

        await self._answered(name, answer())


def _name(item: Value) -> str:
    return str(getattr(item, "name", getattr(item, "type", item)))


async def answer(adapter: Adapter, command: dict[str, Value]) -> dict[str, Value]:
    what = getattr(adapter, command.pop("do"), None)
    if what is None:
        return {"unsupported": "rwt_client has no such call"}
    try:
        await what(**command)
    except Unsupported as error:
        return {"unsupported": str(error)}
    except Exception as error:  # Whatever the library raises is the suite's to judge.
        return {"error": repr(error)}
    return {"ok": True}


async def main() -> None:
    logging.basicConfig(level=logging.WARNING, handlers=[Complaints()])
    adapter = Adapter(say)
    say({"event": "ready", "library": "rwt_client", "version": ""})
    loop = asyncio.get_running_loop()
    while line := await loop.run_in_executor(None, sys.stdin.readline):
        command = json.loads(line)
        number = command.pop("n")
        say({"n": number, **await answer(adapter, command)})


if __name__ == "__main__":
    anyio.run(main)
