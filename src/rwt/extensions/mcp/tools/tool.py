"""Tools of agents: name, arguments and function."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Generic, NotRequired, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from rwt.access.graph_view import STOP, canonical
from rwt.extensions.mcp.agent import Act, Agent
from rwt.extensions.mcp.content.answer import Answer
from rwt.extensions.mcp.errors import ToolError


class Arguments(BaseModel):
    """Arguments of a tool. Unknown ones are rejected, so that misspelt names are reported."""

    model_config = ConfigDict(frozen=True, extra="forbid")


Name = Annotated[str, Field(min_length=1, max_length=256)]
Seconds = Annotated[float, Field(ge=0.0, le=3600.0, allow_inf_nan=False)]

MessageValue = Annotated[
    object,
    Field(
        description="fields of the message; long lists are summarised, and beyond `mcp.result_bytes` it is"
        " a string with the start of its JSON"
    ),
]


class Acted(TypedDict):
    """Result of a tool that acts."""

    gate: NotRequired[
        Annotated[
            list[str],
            Field(description="what the gate changed, such as clamped values, and what waits for approval"),
        ]
    ]


A = TypeVar("A", bound=Arguments)


@dataclass(frozen=True)
class Tool(Generic[A]):
    """Tool for agents.

    Attributes:
        name: name in MCP.
        title: name for people.
        description: purpose and use, for the model.
        arguments: pydantic model of the arguments.
        result: TypedDict of the structured content.
        run: implementation.
        act: required right; None for a tool that only reads.
        named_by: argument with the name of what the tool acts on, if that may be the emergency stop.
        only_looks: True if the tool changes nothing of the robot, although it requires a right.
        can_destroy: False for a tool that only ends what the agent has begun.
        is_idempotent: True if the same call a second time changes nothing more.
        reads_recordings: True if the tool needs the setting `mcp.recordings`.
    """

    name: str
    title: str
    description: str
    arguments: type[A]
    result: type
    run: Callable[[Agent, A], Awaitable[Answer]]
    act: Act | None = None
    named_by: str = ""
    only_looks: bool = False
    can_destroy: bool = True
    is_idempotent: bool = False
    reads_recordings: bool = False

    @cached_property
    def schema(self) -> dict[str, Any]:
        """The JSON Schema of the arguments."""
        return _plain_schema(self.arguments.model_json_schema())

    @cached_property
    def result_schema(self) -> dict[str, Any]:
        """The JSON Schema of the structured content."""
        return _plain_schema(TypeAdapter(self.result).json_schema(mode="serialization"))

    def is_for_stop(self, arguments: Mapping[str, object]) -> bool:
        """Return True for the arguments of a call that presses the emergency stop."""
        return bool(self.named_by) and canonical(str(arguments.get(self.named_by))) == STOP

    def is_offered_to(self, agent: Agent) -> bool:
        """Return True if an agent may use the tool."""
        if self.reads_recordings and agent.recordings is None:
            return False
        return self.act is None or self.act in agent.acts

    async def __call__(self, agent: Agent, arguments: Mapping[str, object]) -> Answer:
        """Run the tool for an agent.

        Raises:
            ToolError: wrong arguments, or the tool failed.
            RobotError: the robot rejected the request.
            AccessError: the agent lacks the right.
        """
        try:
            checked = self.arguments.model_validate(arguments)
        except ValidationError as error:
            raise ToolError(self.complaint(error)) from None
        return await self.run(agent, checked)

    def complaint(self, error: ValidationError) -> str:
        """Return the faults of arguments as text for the agent."""
        said = []
        for each in error.errors(include_url=False, include_context=False)[:5]:
            where = ".".join(map(str, each["loc"]))[:100] or "arguments"
            said.append(f"`{where}`: {each['msg']}")
        known = ", ".join(self.arguments.model_fields)
        return f"{self.name}: {'; '.join(said)}. Arguments: {known}"


def tool(
    title: str,
    result: type,
    *,
    act: Act | None = None,
    named_by: str = "",
    only_looks: bool = False,
    can_destroy: bool = True,
    is_idempotent: bool = False,
    reads_recordings: bool = False,
) -> Callable[[Callable[[Agent, A], Awaitable[Answer]]], Tool[A]]:
    """Make a tool of a function: its name, its docstring for the model, and the model of its arguments."""

    def make(run: Callable[[Agent, A], Awaitable[Answer]]) -> Tool[A]:
        description = " ".join((run.__doc__ or "").split())
        arguments = get_type_hints(run)["asked"]
        return Tool(
            run.__name__, title, description, arguments, result, run,
            act, named_by, only_looks, can_destroy, is_idempotent, reads_recordings,
        )  # fmt: skip

    return make


def _plain_schema(schema: dict[str, Any]) -> dict[str, Any]:
    for part in (schema, *schema.get("$defs", {}).values()):
        part.pop("title", None)
        part.pop("description", None)
        for each in part.get("properties", {}).values():
            each.pop("title", None)
    return schema
