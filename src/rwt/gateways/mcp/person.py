"""Permission of the agent's user during one tool call."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import mcp_types as types
from mcp_types.version import MODERN_PROTOCOL_VERSIONS

from rwt.gateways.mcp.approvals import Question
from rwt.gateways.mcp.errors import AnswerNeeded, ToolError

if TYPE_CHECKING:
    from mcp.server.context import ServerRequestContext

    from rwt.gateways.mcp.approvals import Questions

#: Key of the question and its answer in MCP messages.
KEY: Final = "permission"

_FORM: Final[types.ElicitRequestedSchema] = {
    "type": "object",
    "properties": {
        "allow": {"type": "boolean", "title": "Allow this", "description": "allow this request once"}
    },
    "required": ["allow"],
}

_NO: Final = "the user declined: ask what they want instead, and do not retry"
_CANNOT: Final = (
    "this requires the user's permission, and your client cannot ask: it does not support elicitation with"
    " forms. Tell the user; there is no other way."
)


class Person:
    """Asks the agent's user for permission; the model does not see the question.

    Since the specification of 2026-07-28, the question is the result of a call that is sent again with the
    answer. Older versions ask during the call.

    Args:
        context: context of the call.
        params: the call.
        questions: unanswered questions.
        now: monotonic time in seconds.
    """

    def __init__(
        self,
        context: ServerRequestContext[Any, Any],
        params: types.CallToolRequestParams,
        questions: Questions,
        now: float,
    ) -> None:
        self._context = context
        self._params = params
        self._questions = questions
        self._now = now
        self._arguments = params.arguments or {}
        self._allowed: frozenset[str] | None = None

    async def allow(self, owner: str, what: str) -> None:
        """Ask for permission, unless it was granted already.

        Args:
            owner: identity of the agent.
            what: request to permit, as a verb phrase.

        Raises:
            ToolError: the user declined or cannot be asked.
            AnswerNeeded: the answer will come with another request.
        """
        if not self._can_ask():
            raise ToolError(_CANNOT)
        text = f"May the agent {what[:2000]}?"
        if self._context.protocol_version in MODERN_PROTOCOL_VERSIONS:
            self._require_answer(owner, text)
        else:
            _require_yes(await self._context.session.elicit_form(text, _FORM, self._context.request_id))

    def _can_ask(self) -> bool:
        capabilities = self._context.session.client_capabilities
        asks = None if capabilities is None else capabilities.elicitation
        return asks is not None and (asks.form is not None or asks.url is None)

    def _require_answer(self, owner: str, text: str) -> None:
        if self._allowed is None:
            self._allowed = self._read_answer(owner)
        if text not in self._allowed:
            question = Question(text, self._allowed)
            word = self._questions.ask(question, owner, self._params.name, self._arguments, self._now)
            raise AnswerNeeded(text, word)

    def _read_answer(self, owner: str) -> frozenset[str]:
        """Return the permissions in the answer that came with the call."""
        word = self._params.request_state
        answer = (self._params.input_responses or {}).get(KEY)
        if word is None or not isinstance(answer, types.ElicitResult):
            return frozenset()
        asked = self._questions.answered(word, owner, self._params.name, self._arguments, self._now)
        if asked is None:
            return frozenset()
        _require_yes(answer)
        return asked.allowed | {asked.text}


def _require_yes(answer: types.ElicitResult) -> None:
    if answer.action != "accept" or (answer.content or {}).get("allow") is not True:
        raise ToolError(_NO)


def asked(needed: AnswerNeeded) -> types.InputRequiredResult:
    """The question as the answer to a call."""
    form = types.ElicitRequestFormParams(message=needed.question, requested_schema=_FORM)
    return types.InputRequiredResult(
        input_requests={KEY: types.ElicitRequest(params=form)}, request_state=needed.key
    )
