"""Errors of the MCP gateway, in addition to those of :mod:`rwt_participant.errors`."""

from __future__ import annotations


class ToolError(Exception):
    """A tool cannot do what it was asked. The text is for the agent: what is wrong, and what to do."""


class AnswerNeeded(Exception):
    """A person must be asked before a tool continues; the answer is expected under `key`."""

    def __init__(self, question: str, key: str) -> None:
        super().__init__(question)
        self.question = question
        self.key = key
