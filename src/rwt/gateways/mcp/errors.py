"""Errors of the MCP gateway, in addition to those of :mod:`rwt_participant.errors`.

* :exc:`AgentError`

  * :exc:`ToolError`: a tool cannot do what it was asked; the agent is told, and what to do instead.
  * :exc:`AnswerNeeded`: a person has to be asked first, by the agent's program.
"""

from __future__ import annotations


class AgentError(Exception):
    """Base of everything here."""


class ToolError(AgentError):
    """A tool cannot do what it was asked. The text is for the agent: what is wrong, and what to do."""


class AnswerNeeded(AgentError):
    """A person must be asked before a tool continues.

    Attributes:
        key: under which the answer is expected.
    """

    def __init__(self, question: str, key: str) -> None:
        super().__init__(question)
        self.question = question
        self.key = key
