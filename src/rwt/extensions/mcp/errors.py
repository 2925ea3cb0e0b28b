"""Errors of the MCP gateway, in addition to those of :mod:`rwt_participant.errors`."""

from __future__ import annotations


class ToolError(Exception):
    """A tool failed. The text is for the agent: the cause and the remedy."""


class AnswerNeeded(Exception):
    """A tool needs a person's permission to continue; the answer is expected under `key`."""

    def __init__(self, question: str, key: str) -> None:
        super().__init__(question)
        self.question = question
        self.key = key
