"""The tools, resources and prompts as a server of the official SDK."""

from __future__ import annotations

import base64
import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import mcp_types as types
import msgspec
from mcp.server.lowlevel import Server
from mcp.shared.exceptions import MCPError

from rwt.access.errors import AccessError
from rwt.extensions.mcp.content.answer import Part, Picture, as_text
from rwt.extensions.mcp.errors import AnswerNeeded, ToolError
from rwt.extensions.mcp.guides import INSTRUCTIONS, PROMPTS, RESOURCES, Resource, read_resource
from rwt.extensions.mcp.person import Person, asked
from rwt.extensions.mcp.subscriptions import ResourceSubscriptions
from rwt.extensions.mcp.tools import TOOLS
from rwt.gateways.visitors import Metered
from rwt_participant.errors import RobotError
from rwt_transports.background import background_tasks
from rwt_transports.http.routes import any_of

if TYPE_CHECKING:
    from anyio.abc import TaskGroup
    from mcp.server.context import ServerRequestContext

    from rwt.extensions.mcp.agent import Act, Agent, Host
    from rwt.extensions.mcp.tools.tool import Tool

    Context = ServerRequestContext[Any, Any]

logger = logging.getLogger(__name__)


def make_server(host: Host, version: str, *, keeps_sessions: bool = True) -> Server[TaskGroup]:
    """Server of one gateway, or of one program connected over standard input and output."""
    handlers, subscriptions = _Handlers(host), ResourceSubscriptions(host)
    return Server(
        "robot-web-tools",
        version=version,
        title="Robot",
        instructions=INSTRUCTIONS,
        lifespan=lambda server: background_tasks(),  # Of all subscriptions.
        get_tool_input_schema=lambda name: TOOLS[name].schema if name in TOOLS else None,
        on_list_tools=handlers.list_tools,
        on_call_tool=handlers.call_tool,
        on_list_resources=handlers.list_resources,
        on_list_resource_templates=handlers.list_templates,
        on_read_resource=handlers.read_resource,
        on_subscribe_resource=subscriptions.subscribe if keeps_sessions else None,
        on_unsubscribe_resource=subscriptions.unsubscribe if keeps_sessions else None,
        on_subscriptions_listen=subscriptions.listen,
        on_list_prompts=handlers.list_prompts,
        on_get_prompt=handlers.get_prompt,
    )


class _Handlers:
    """Return the handlers of the protocol's requests."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self._asks_about = any_of(host.settings.confirm)

    async def list_tools(
        self, context: Context, params: types.PaginatedRequestParams | None
    ) -> types.ListToolsResult:
        async with self._host.agent(context) as agent:
            offered = [_described(tool) for tool in TOOLS.values() if tool.is_offered_to(agent)]
        return types.ListToolsResult(tools=offered)

    async def call_tool(
        self, context: Context, params: types.CallToolRequestParams
    ) -> types.CallToolResult | types.InputRequiredResult:
        """Run a tool; errors are returned as its result, for the model to read."""
        tool, given = TOOLS.get(params.name), params.arguments or {}
        if tool is None:
            raise MCPError(types.INVALID_PARAMS, f"there is no tool {params.name[:100]!r}: see tools/list")
        said = f"{tool.name} {as_text(given)}"
        self._host.note(context, said, acts=tool.act is not None)
        person = Person(context, params, self._host.questions)
        notices: Sequence[str] = ()
        try:
            async with self._host.agent(context, person.allow) as agent:
                notices = agent.notices
                if not (tool.is_offered_to(agent) or (agent.may_stop and tool.is_for_stop(given))):
                    raise ToolError(_not_offered(tool, agent))
                heard = replace(
                    agent,
                    confirm=partial(self._confirm, context, person, agent.owner),
                    report_progress=context.session.report_progress,
                )
                answer = await Metered(tool(heard, given), agent.charge, time.monotonic)
        except AnswerNeeded as needed:
            self._host.count(tool.name, "asked")
            return asked(needed)
        except (ToolError, RobotError, AccessError) as error:
            self._host.count(tool.name, "refused")
            self._host.note(context, f"{tool.name}: refused: {error}", acts=tool.act is not None)
            content = [_content(part) for part in (str(error), *_of_gate(notices))]
            return types.CallToolResult(content=content, is_error=True)
        except Exception:
            # The agent learns that it failed, and only the log why.
            self._host.count(tool.name, "failed")
            logger.exception("the tool %s failed", tool.name)
            return types.CallToolResult(content=[types.TextContent(text="internal error")], is_error=True)
        self._host.count(tool.name, "done")
        data = {**answer.data, "gate": list(notices)} if notices else dict(answer.data)
        return types.CallToolResult(
            content=[_content(part) for part in (*answer.parts, *_of_gate(notices))],
            # Through text, since a message may contain bytes and numbers that JSON lacks.
            structured_content=msgspec.json.decode(as_text(data)),
        )

    async def _confirm(
        self, context: Context, person: Person, owner: str, act: Act, name: str, what: str
    ) -> None:
        if self._asks_about.fullmatch(name.lower()) is not None:
            await person.allow(owner, what)
            self._host.note(context, f"{act} {name}: the person allowed it", acts=True)

    async def list_resources(
        self, context: Context, params: types.PaginatedRequestParams | None
    ) -> types.ListResourcesResult:
        plain = [types.Resource(uri=each.uri, **_about(each)) for each in RESOURCES if not each.is_template]
        return types.ListResourcesResult(resources=plain)

    async def list_templates(
        self, context: Context, params: types.PaginatedRequestParams | None
    ) -> types.ListResourceTemplatesResult:
        templates = [
            types.ResourceTemplate(uri_template=each.uri, **_about(each))
            for each in RESOURCES
            if each.is_template
        ]
        return types.ListResourceTemplatesResult(resource_templates=templates)

    async def read_resource(
        self, context: Context, params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        uri = str(params.uri)
        self._host.note(context, f"read {uri}", acts=False)
        try:
            async with self._host.agent(context) as agent:
                answer = await Metered(read_resource(agent, uri), agent.charge, time.monotonic)
        except (ToolError, RobotError, AccessError) as error:
            raise MCPError(types.INVALID_PARAMS, str(error)) from None
        return types.ReadResourceResult(contents=[_resource_content(uri, part) for part in answer])

    async def list_prompts(
        self, context: Context, params: types.PaginatedRequestParams | None
    ) -> types.ListPromptsResult:
        return types.ListPromptsResult(
            prompts=[
                types.Prompt(
                    name=each.name,
                    title=each.title,
                    description=each.description,
                    arguments=[
                        types.PromptArgument(name=name, description=about, required=True)
                        for name, about in each.arguments.items()
                    ],
                )
                for each in PROMPTS.values()
            ]
        )

    async def get_prompt(
        self, context: Context, params: types.GetPromptRequestParams
    ) -> types.GetPromptResult:
        prompt = PROMPTS.get(params.name)
        if prompt is None:
            known = ", ".join(PROMPTS)
            raise MCPError(
                types.INVALID_PARAMS, f"there is no prompt {params.name[:100]!r}; there are {known}"
            )
        try:
            text = prompt.fill_in(params.arguments or {})
        except ToolError as error:
            raise MCPError(types.INVALID_PARAMS, str(error)) from None
        return types.GetPromptResult(
            description=prompt.description,
            messages=[types.PromptMessage(role="user", content=types.TextContent(text=text))],
        )


def _about(resource: Resource) -> dict[str, str]:
    return {"name": resource.uri, "title": resource.title, "description": resource.description}


def _of_gate(notices: Sequence[str]) -> Sequence[str]:
    """Return a line about what the gate did to a command, for an agent that only reads texts."""
    return ["the gate: " + "; ".join(notices)] if notices else []


def _not_offered(tool: Tool[Any], agent: Agent) -> str:
    if tool.act is None:
        return "there are no recordings to look at here (mcp.recordings)"
    return (
        f"this agent may only look: {tool.name} needs a role with `{tool.act}`. A person can change that:"
        f" {agent.how_to_act}. Tell them; there is no other way."
    )


def _described(tool: Tool[Any]) -> types.Tool:
    looks = tool.act is None or tool.only_looks
    return types.Tool(
        name=tool.name,
        title=tool.title,
        description=tool.description,
        input_schema=dict(tool.schema),
        output_schema=dict(tool.result_schema),
        annotations=types.ToolAnnotations(
            read_only_hint=looks,
            destructive_hint=None if looks else tool.can_destroy,
            idempotent_hint=None if looks else tool.is_idempotent,
            open_world_hint=not looks,
        ),
    )


def _content(part: Part) -> types.TextContent | types.ImageContent:
    if isinstance(part, Picture):
        return types.ImageContent(data=base64.b64encode(part.data).decode(), mime_type=part.mime_type)
    return types.TextContent(text=part)


def _resource_content(uri: str, part: Part) -> types.TextResourceContents | types.BlobResourceContents:
    if isinstance(part, Picture):
        data = base64.b64encode(part.data).decode()
        return types.BlobResourceContents(uri=uri, blob=data, mime_type=part.mime_type)
    return types.TextResourceContents(uri=uri, text=part, mime_type="text/plain")
