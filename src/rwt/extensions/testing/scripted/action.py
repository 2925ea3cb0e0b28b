"""Scripted action: feedback, then an outcome."""

from __future__ import annotations

from collections.abc import Sequence

import anyio

from rwt.extensions.testing.errors import check_messages
from rwt.extensions.testing.journal import Journal, Kind, Received
from rwt_graph.clock import Clock
from rwt_interfaces.structs import ActionType, MessageType
from rwt_participant.errors import GoalAborted, GoalCanceled
from rwt_participant.goals import Execute, ReceivedGoal
from rwt_participant.messages import Message, MessageLike, to_payload


class ScriptedAction:
    """Action of a scripted robot. By default, goals succeed with a default result.

    A goal whose cancellation is requested is canceled, unless :meth:`ignores_cancel` was called. Each method
    returns the action.

    Attributes:
        name: absolute name.
    """

    def __init__(self, name: str, interface: ActionType, clock: Clock, journal: Journal) -> None:
        self.name = name
        self.type = interface
        self._clock = clock
        self._journal = journal
        self._feedback: tuple[MessageLike, ...] = ()
        self._every = 0.0
        self._refusal: str | None = None
        self._cancels = True
        self._end: Execute = self._succeeding(None)
        self._execute: Execute | None = None

    @property
    def goals(self) -> list[Message]:
        """Received goals, oldest first, including rejected ones."""
        return [entry.message for entry in self._journal.of(Kind.GOAL, self.name)]

    def feedback(self, *messages: MessageLike, every: float = 0.0) -> ScriptedAction:
        """Send these messages to each goal in turn; the goal ends after the last.

        Args:
            every: seconds of the robot's clock before each message.

        Raises:
            ScriptError: a message does not fit the action's feedback.
        """
        self._check(self.type.feedback, messages)
        self._feedback, self._every, self._execute = messages, every, None
        return self

    def succeeds(self, result: MessageLike | None = None, after: float = 0.0) -> ScriptedAction:
        """Make goals succeed, `after` seconds of the robot's clock later. Raises like `feedback`."""
        self._check(self.type.result, (result,))
        return self._ends(self._succeeding(result, after))

    def aborts(
        self, result: MessageLike | None = None, reason: str = "", after: float = 0.0
    ) -> ScriptedAction:
        """Abort goals, `after` seconds of the robot's clock later. Raises like `feedback`."""
        self._check(self.type.result, (result,))

        async def abort(goal: ReceivedGoal) -> MessageLike | None:
            await self._wait(goal, after)
            raise GoalAborted(result, reason)

        return self._ends(abort)

    def rejects(self, reason: str = "") -> ScriptedAction:
        """Reject all goals."""
        self._refusal = reason or f"{self.name} rejects every goal"
        return self

    def never_ends(self) -> ScriptedAction:
        """Keep goals executing until they are canceled."""

        async def go_on(goal: ReceivedGoal) -> MessageLike | None:
            await goal.cancel_event.wait()
            self._end_if_canceled(goal)
            await anyio.sleep_forever()
            return None

        return self._ends(go_on)

    def ignores_cancel(self) -> ScriptedAction:
        """Ignore requests to cancel."""
        self._cancels = False
        return self

    def calls(self, execute: Execute) -> ScriptedAction:
        """Run goals with a coroutine function, as in :meth:`rwt_graph.Node.advertise_action`."""
        self._refusal, self._execute = None, execute
        return self

    def accept(self, request: Message) -> bool | str:
        """Record a goal, and decide on it."""
        payload = to_payload(self.type.goal, request, self._clock.time_ns)
        self._journal.add(Received(Kind.GOAL, self.name, payload, "", self._clock.time_ns()))
        return True if self._refusal is None else self._refusal

    async def execute(self, goal: ReceivedGoal) -> MessageLike | None:
        """Run one goal."""
        if self._execute is not None:
            return await self._execute(goal)
        end = self._end
        for message in self._feedback:
            await self._wait(goal, self._every)
            goal.publish_feedback(message)
        return await end(goal)

    def _ends(self, end: Execute) -> ScriptedAction:
        self._refusal, self._execute, self._end = None, None, end
        return self

    def _succeeding(self, result: MessageLike | None, after: float = 0.0) -> Execute:
        async def succeed(goal: ReceivedGoal) -> MessageLike | None:
            await self._wait(goal, after)
            return result

        return succeed

    async def _wait(self, goal: ReceivedGoal, seconds: float) -> None:
        """Sleep, but wake when the goal's cancellation is requested."""
        if not self._cancels:
            await self._clock.sleep(seconds)
            return
        if seconds > 0:
            async with anyio.create_task_group() as tasks:

                async def watch() -> None:
                    await goal.cancel_event.wait()
                    tasks.cancel_scope.cancel()

                tasks.start_soon(watch)
                await self._clock.sleep(seconds)
                tasks.cancel_scope.cancel()
        self._end_if_canceled(goal)

    def _end_if_canceled(self, goal: ReceivedGoal) -> None:
        if self._cancels and goal.cancel_requested:
            raise GoalCanceled

    def _check(self, kind: MessageType, messages: Sequence[MessageLike | None]) -> None:
        check_messages(kind, messages, self._clock.time_ns, self.name)
