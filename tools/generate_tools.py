"""Write docs/reference/agents.md from the tools, resources and prompts of agents.

Run it after a change of `rwt.extensions.mcp.tools` or `rwt.extensions.mcp.guides`: ``python tools/generate_tools.py``. A test
compares.
"""

# ruff: noqa: E501 - a row of a Markdown table is one line

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from rwt.extensions.mcp.guides import INSTRUCTIONS, PROMPTS, RESOURCES
from rwt.extensions.mcp.tools import TOOLS
from rwt.extensions.mcp.tools.tool import Tool

TARGET: Final = Path(__file__).parents[1] / "docs" / "reference" / "agents.md"

_HEAD: Final = """\
# Tools of agents

This page is generated from the program by `tools/generate_tools.py`. Agents connect over HTTP at `/mcp` or by the command
`rwt mcp`: see [the how-to](../how-to/agents.md).

Supported versions of the Model Context Protocol: 2026-07-28 (without sessions), 2025-11-25, 2025-06-18, 2025-03-26 and
2024-11-05. A tool that fails returns the reason and what to do instead. Results have text, and structured content with
the fields that `outputSchema` of the tool describes. `mcp.result_bytes` limits the text of a result and each message in its
structured content, `mcp.picture_pixels` the width and height of an image, `mcp.longest_seconds` the duration of a call.

Results of tools that act have the field `gate` if the [gate](../how-to/gate.md) clamped a value or required approval. Its lines are
part of the text, too, also if the call fails.
"""

_SUBSCRIPTIONS: Final = """
Agents can subscribe to `robot://topics/…`, by `resources/subscribe` in a session or `subscriptions/listen` since 2026-07-28: they are
notified of new messages, at most once a second for each topic. A session or stream has at most 16 topics, and an agent at most
`mcp.requests_per_address`.
"""


def page() -> str:
    """The whole page."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield _HEAD
    yield "## Instructions for every agent\n"
    yield "\n".join(f"> {line}" for line in INSTRUCTIONS.splitlines()) + "\n"
    for title, is_wanted in (("Tools that read", False), ("Tools that act", True)):
        yield f"## {title}\n"
        for tool in TOOLS.values():
            if (tool.act is not None) is is_wanted:
                yield from _tool(tool)
    yield "## Resources\n"
    yield "| URI | content |\n|---|---|"
    for resource in RESOURCES:
        yield f"| `{resource.uri}` | {resource.description} |"
    yield _SUBSCRIPTIONS
    yield "## Prompts\n"
    yield "| name | purpose | arguments |\n|---|---|---|"
    for prompt in PROMPTS.values():
        arguments = "; ".join(f"`{name}`: {about}" for name, about in prompt.arguments.items())
        yield f"| `{prompt.name}` | {prompt.description} | {arguments} |"
    yield ""


def _tool(tool: Tool[Any]) -> Iterator[str]:
    yield f"### {tool.name}\n"
    needs = "" if tool.act is None else f" Needs a role with `{tool.act}`."
    only = " Available if `mcp.recordings` names a folder." if tool.reads_recordings else ""
    yield f"{tool.description}{needs}{only}\n"
    yield "| argument | type | default | meaning |\n|---|---|---|---|"
    required = tool.schema.get("required", ())
    for name, each in tool.schema["properties"].items():
        default = "" if name in required else f"`{json.dumps(each.get('default'))}`"
        yield f"| `{name}` | {_type(each)} | {default} | {each.get('description', '')} |"
    results = ", ".join(f"`{name}`" for name in tool.result_schema["properties"])
    yield f"\nResult: {results}.\n"


def _type(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(f"`{each}`" for each in schema["enum"])
    if schema.get("type") == "array":
        return f"list of {_type(schema['items'])}"
    return str(schema.get("type", "any"))


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
