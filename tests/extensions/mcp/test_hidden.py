"""Names hidden by a role, with every tool of an agent."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Settings
from tests.core.access.test_fail_closed import ABSENT, GUEST, HIDDEN
from tests.extensions.mcp.agents import agent_at, served, text_of, url_of

pytestmark = [pytest.mark.anyio, pytest.mark.timeout(120)]

SETTINGS = Settings.model_validate(
    {
        "gateways": ["mcp"],
        "auth": {"default_role": "guest"},
        "roles": {"guest": GUEST},
        "mcp": {"default_role": "guest"},
    }
)

#: Each tool that takes a name, with the kind of thing that it is the name of.
NAMING: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("read_topic", "topic", {"timeout": 0.05}),
    ("watch_numbers", "topic", {"seconds": 0.05}),
    ("wait_for", "topic", {"field": "data", "comparison": "==", "value": "", "timeout": 0.05}),
    ("get_parameter", "name", {}),
    ("set_parameter", "name", {"value": 1.0}),
    ("publish", "topic", {"message": {}}),
    ("call_service", "service", {}),
    ("send_goal", "action", {"timeout": 0}),
)
LISTS = (
    {"kinds": ["topics", "services", "actions", "parameters"], "plumbing": True},
    {"filter": f"*{HIDDEN}*", "plumbing": True},
)


async def test_no_tool_tells_what_is_hidden() -> None:
    async with served(SETTINGS) as server:
        for word in ("open", HIDDEN):
            node = server.node(f"{word}_node")
            node.advertise(f"/{word}_topic", "std_msgs/String")
            node.advertise_service(f"/{word}_service", "std_srvs/Trigger", lambda _: {"success": True})
            node.advertise_action(f"/{word}_action", "example_interfaces/Fibonacci", _nothing)
            node.parameters.declare(f"{word}_param", 1.0)
        async with agent_at(url_of(server)) as agent:
            for arguments in LISTS:
                listed = text_of(await agent.call_tool("list_robot", arguments))
                assert HIDDEN not in listed and ("open_topic" in listed or "filter" in arguments)
            assert "/open_node:open_param" in text_of(await agent.call_tool("list_robot", LISTS[0]))
            for tool, argument, others in NAMING:
                for suffix in ("_topic", "_service", "_action", "_node", "_node:param"):
                    texts = [
                        text_of(await agent.call_tool(tool, {argument: f"/{word}{suffix}", **others}))
                        for word in (HIDDEN, ABSENT)
                    ]
                    assert texts[0].replace(HIDDEN, ABSENT) == texts[1], (tool, suffix)


async def _nothing(_: object) -> None:
    """An action that ends at once."""
