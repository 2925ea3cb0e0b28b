"""Permission of the agent's user during one tool call."""

from __future__ import annotations

import hashlib
import json
import secrets
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import mcp_types as types
from mcp_types.version import MODERN_PROTOCOL_VERSIONS

from rwt.extensions.mcp.errors import AnswerNeeded, ToolError

if TYPE_CHECKING:
    from mcp.server.context import ServerRequestContext


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


_ANSWER_SECONDS: Final = 600.0
"""Time to wait for an answer, in seconds."""

_MAX_QUESTIONS: Final = 256
"""Maximum number of pending questions; beyond it the oldest are forgotten."""


class _Pending(NamedTuple):
    allowed: frozenset[str]
    digest: bytes
    until: float


class Questions:
    """Questions whose answers come with a later request.

    Each is for one action by one owner with identical arguments, and is answered once.
    """

    def __init__(self) -> None:
        self._pending: dict[str, _Pending] = {}

    def ask(
        self, allowed: frozenset[str], owner: str, tool: str, arguments: Mapping[str, object], now: float
    ) -> str:
        """Note a question and what its answer allows, and return the token under which the answer comes."""
        while len(self._pending) >= _MAX_QUESTIONS:
            del self._pending[next(iter(self._pending))]
        token = secrets.token_urlsafe(24)
        self._pending[token] = _Pending(allowed, _digest(owner, tool, arguments), now + _ANSWER_SECONDS)
        return token

    def answered(
        self, token: str, owner: str, tool: str, arguments: Mapping[str, object], now: float
    ) -> frozenset[str] | None:
        """Return what an answer to a question with the same arguments allows; None if it is unknown."""
        # Removed even if it does not match: each question can be answered once.
        pending = self._pending.pop(token, None)
        if pending is None or now > pending.until or pending.digest != _digest(owner, tool, arguments):
            return None
        return pending.allowed


def _digest(owner: str, tool: str, arguments: Mapping[str, object]) -> bytes:
    return hashlib.sha256(json.dumps([owner, tool, arguments], sort_keys=True).encode()).digest()


class Person:
    """Asks the agent's user for permission; the model does not see the question.

    Since the specification of 2026-07-28, the question is the result of a call that is sent again with the
    answer. Older versions ask during the call.
    """

    def __init__(
        self,
        context: ServerRequestContext[Any, Any],
        params: types.CallToolRequestParams,
        questions: Questions,
    ) -> None:
        self._context = context
        self._params = params
        self._questions = questions
        self._now = time.monotonic()
        self._arguments = params.arguments or {}
        self._allowed: frozenset[str] | None = None

    async def allow(self, owner: str, what: str) -> None:
        """Ask for permission of `what`, a verb phrase, unless it was granted already.

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
        # A client that names no mode of elicitation supports forms, the only mode of older versions.
        return asks is not None and (asks.form is not None or asks.url is None)

    def _require_answer(self, owner: str, text: str) -> None:
        if self._allowed is None:
            self._allowed = self._read_answer(owner)
        if text not in self._allowed:
            # A call may need several permissions but carries one answer, which includes the earlier ones.
            wanted = self._allowed | {text}
            token = self._questions.ask(wanted, owner, self._params.name, self._arguments, self._now)
            raise AnswerNeeded(text, token)

    def _read_answer(self, owner: str) -> frozenset[str]:
        """Return the permissions in the answer that came with the call."""
        token = self._params.request_state
        answer = (self._params.input_responses or {}).get(KEY)
        if token is None or not isinstance(answer, types.ElicitResult):
            return frozenset()
        allowed = self._questions.answered(token, owner, self._params.name, self._arguments, self._now)
        if allowed is None:
            return frozenset()
        _require_yes(answer)
        return allowed


def _require_yes(answer: types.ElicitResult) -> None:
    if answer.action != "accept" or (answer.content or {}).get("allow") is not True:
        raise ToolError(_NO)


def asked(needed: AnswerNeeded) -> types.InputRequiredResult:
    """Return the question as the result of a call."""
    form = types.ElicitRequestFormParams(message=needed.question, requested_schema=_FORM)
    return types.InputRequiredResult(
        input_requests={KEY: types.ElicitRequest(params=form)}, request_state=needed.key
    )
