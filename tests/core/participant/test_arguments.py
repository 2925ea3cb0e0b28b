"""Arguments in the wrong order: an error at the call, with the signature."""

from __future__ import annotations

import inspect
from typing import Any, Final

import pytest

from tests.core.client.worlds import world

pytestmark = pytest.mark.anyio

TYPE: Final = "std_msgs/String"


def callback(message: object) -> None:
    raise AssertionError("never called")


MISTAKES: Final[dict[str, tuple[object, ...]]] = {
    "subscribe": ("/q", TYPE),
    "subscribe ": ("/q", TYPE, callback),
    "subscribe_raw": ("/q", TYPE),
    "topic": ("/q", callback),
    "once": ("/q", callback),
    "advertise": ("/q", callback),
    "publish": ("/q", TYPE, {"data": "hello"}),
    "call": ("/s", "std_srvs/Trigger", {}),
    "advertise_service": ("/s", callback, "std_srvs/Trigger"),
    "advertise_service ": ("/s", "std_srvs/Trigger", None),
    "send_goal": ("/a", "example_interfaces/Fibonacci", {}),
    "advertise_action": ("/a", callback, "example_interfaces/Fibonacci"),
    "create_timer": (callback, 1.0),
    "create_timer ": (1.0, "tick"),
}


@pytest.mark.parametrize("program", ["node", "robot"])
@pytest.mark.parametrize("verb", MISTAKES)
async def test_arguments_in_the_wrong_order(program: str, verb: str) -> None:
    name = verb.strip()
    async with world() as it:
        method: Any = getattr(getattr(it, program), name)
        with pytest.raises(TypeError, match=rf"^({name}|topic)\(.*\): "):
            returned = method(*MISTAKES[verb])
            if inspect.isawaitable(returned):
                await returned
        assert it.graph.topic("/q") is None
