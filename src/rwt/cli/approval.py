"""Progress of a command that the robot's gate holds for human approval."""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import Awaitable, Callable
from math import ceil, inf
from typing import TYPE_CHECKING, Final, Literal, TypeVar

import anyio

from rwt.cli.console.output import note, printable
from rwt_participant.errors import CallTimeout

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_client.events import ConnectionEvent

T = TypeVar("T")

#: Status messages of the server, see :attr:`rwt.access.gate.approvals.Approval.progress`.
_WAITING: Final = re.compile(r"gate: .+: waiting for approval by (.+) \(([\d.]+) s left, id (\d+)\)")
_APPROVED: Final = re.compile(r"gate: .+: approved \(id (\d+)\)")
_DENIED: Final = re.compile(r"gate: (.+), id (\d+)")

_CLEAR_LINE: Final = "\r\x1b[K"


class ApprovalProgress:
    """Line on standard error while a command waits for approval, updated each second on a terminal.

    Attributes:
        state: state of the last request for approval; empty without one.
        why: reason of a denial.
    """

    def __init__(self, robot: Robot) -> None:
        self.state: Literal["", "waiting", "approved", "denied"] = ""
        self.why = ""
        self._robot = robot
        # The last request: its id, the roles that may approve it, and when it expires on anyio's clock.
        self._id = self._roles = ""
        self._until = 0.0
        # The command in :meth:`run`: its arguments, and the scope that ends it.
        self._timeout = inf
        self._extends = False
        self._scope: anyio.CancelScope | None = None
        self._decided: anyio.Event  # Created by each :meth:`run`.
        self._is_live = sys.stderr.isatty()

    async def run(
        self, command: Callable[[], Awaitable[T]], seconds: float | None = None, *, extends: bool = False
    ) -> T:
        """Run a command.

        Args:
            seconds: timeout; None: no timeout.
            extends: True if time for which the command waits for approval does not count.

        Raises:
            CallTimeout: it took longer.
        """
        self._timeout = inf if seconds is None else seconds
        self._extends = extends
        self._decided = anyio.Event()
        outcome: list[T | Exception] = []
        end = self._robot.on_event(self._on_event)
        logger = logging.getLogger("rwt_client")
        logger.addFilter(_is_other)
        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(self._show)
                with anyio.CancelScope(deadline=anyio.current_time() + self._timeout) as self._scope:
                    try:
                        outcome.append(await command())
                    except Exception as error:  # Not in the task group, which would wrap it.
                        outcome.append(error)
                tasks.cancel_scope.cancel()
        finally:
            self._clear()
            logger.removeFilter(_is_other)
            end()
        if not outcome:
            raise CallTimeout(f"no answer within {seconds:g} s")
        result = outcome[0]
        if isinstance(result, Exception):
            raise result
        return result

    async def decided(self) -> None:
        """Wait until the request for approval, if there is one, is approved or denied."""
        if self.state == "waiting":
            with anyio.move_on_after(self._until - anyio.current_time()):
                await self._decided.wait()

    def _on_event(self, event: ConnectionEvent) -> None:
        if event.kind != "status":
            return
        now = anyio.current_time()
        if found := _WAITING.fullmatch(event.text):
            self.state, self._roles, self._id = "waiting", found[1], found[3]
            self._until = now + float(found[2])
            self._print()
            deadline = inf
        elif (found := _APPROVED.fullmatch(event.text)) and found[1] == self._id:
            self._end("approved")
            deadline = now + self._timeout
        elif (found := _DENIED.fullmatch(event.text)) and found[2] == self._id:
            self.why = found[1]
            self._end("denied")
            deadline = now + self._timeout
        else:
            return
        if self._scope is not None and self._extends:
            self._scope.deadline = deadline

    def _end(self, state: Literal["approved", "denied"]) -> None:
        self._clear()
        self.state = state
        self._decided.set()
        note(state)

    def _print(self) -> None:
        left = max(0, ceil(self._until - anyio.current_time()))
        text = f"waiting for approval by {self._roles} ({left} s left)"
        if self._is_live:
            sys.stderr.write(f"{_CLEAR_LINE}{printable(text)}")
            sys.stderr.flush()
        else:
            note(text)

    def _clear(self) -> None:
        if self._is_live and self.state == "waiting":
            sys.stderr.write(_CLEAR_LINE)
            sys.stderr.flush()

    async def _show(self) -> None:
        while self._is_live:
            await anyio.sleep(1.0)
            if self.state == "waiting":
                self._print()


def _is_other(record: logging.LogRecord) -> bool:
    """Return False for log lines about status messages that :class:`ApprovalProgress` shows."""
    return not any(
        isinstance(each, str) and (_WAITING.fullmatch(each) or _APPROVED.fullmatch(each))
        for each in (record.args or ())
    )
