"""Action ops of one client: goals, cancel requests, feedback and results, in both directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, Never

from rwt.access.client_graph import ClientGraph
from rwt.rosbridge.ops.offers import Offers, PeerOffers, Provided
from rwt.rosbridge.ops.payloads import (
    IN_STEPS,
    arguments_in_steps,
    arguments_of,
    failure_text,
    object_or_empty,
    payload_in_steps,
    payload_of,
)
from rwt.rosbridge.ops.services import split_suffix
from rwt.rosbridge.reply import Replies
from rwt_graph.api import ClientGoal, GoalEvents, ServerGoal
from rwt_graph.errors import InvalidTransition
from rwt_graph.names import resolve
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType
from rwt_participant.errors import CallFailed, ProviderNotFound
from rwt_participant.goals import GoalStatus
from rwt_protocol.dispatcher import Steps
from rwt_protocol.errors import Refused
from rwt_protocol.ops import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    CancelActionGoal,
    Op,
    SendActionGoal,
    UnadvertiseAction,
)
from rwt_transports.shared_pool import Holder, PoolRow, Share, SharedPool

#: Paths of the payloads in their ops, for errors.
_GOAL: Final = "send_action_goal.args"
_FEEDBACK: Final = "action_feedback.values"
_RESULT: Final = "action_result.values"

_OUTCOMES: Final = frozenset({GoalStatus.SUCCEEDED, GoalStatus.CANCELED})

#: Maximum number of stored goals whose sender has disconnected, for a later `cancel_action_goal`.
_MAX_ORPHANS: Final = 1000

ORPHANS: Final = PoolRow("goals without their clients", "", "goals of clients that have left")


class Orphans:
    """Running goals of clients that have left, which these can still cancel (ACT-19).

    Beyond the maximum, the oldest of the client with most is forgotten; the goal itself continues.
    """

    def __init__(self) -> None:
        self._pool = SharedPool(ORPHANS, _MAX_ORPHANS)
        self._goals: dict[PeerGoal, tuple[str, Share]] = {}

    def add(self, goal: PeerGoal, address: str, holder: Holder) -> None:
        """Add a goal of a client at an address."""
        share = self._pool.take(holder, lambda reason: self.discard(goal), 0)
        self._goals[goal] = address, share
        self._pool.resize(share, 1)

    def discard(self, goal: PeerGoal) -> None:
        """Remove a goal that has ended; idempotent."""
        found = self._goals.pop(goal, None)
        if found is not None:
            self._pool.release(found[1])

    def find(self, address: str, action: str, id: str | int | None) -> PeerGoal | None:
        """Return the newest goal that a client of the address sent to the action under an id."""
        for goal, (sender, _) in reversed(self._goals.items()):
            if (sender, goal.action, goal.id) == (address, action, id):
                return goal
        return None


class PeerGoal:
    """Goal of a client, until its result; `id` is the client's, `goal` the one in the graph."""

    __slots__ = ("_client", "_fragment_size", "_listening", "_name", "action", "ended", "goal", "id")

    def __init__(self, client: PeerActions, op: SendActionGoal, args: Payload | None) -> None:
        name, suffix = split_suffix(op.action)
        self._client = client
        # Not the op: its arguments would be kept as long as the goal is active.
        self._name = op.action
        self._fragment_size = op.fragment_size
        self._listening = True
        self.ended = False
        self.action = resolve(name)
        self.id = suffix if op.id is None else op.id
        events = GoalEvents(on_result=self._on_result, on_feedback=self._on_feedback if op.feedback else None)

        def goal_of(type: ActionType) -> Payload:
            client.graph.registry.action(op.action_type)
            if args is not None and args.type is type.goal:
                return args
            return arguments_of(type.goal, op.args, _GOAL, client.now)

        self.goal: ClientGoal | None = None  # Until the call returns: its callbacks may come before.
        self.goal = client.graph.send_goal(self.action, goal_of, events)

    def orphan(self) -> None:
        """Stop reporting: the client has disconnected, and the goal continues (ACT-19)."""
        self._listening = False
        # The provider need not encode feedback that nobody receives.
        if self.goal is not None:
            self.goal.want_feedback(False)

    def _on_feedback(self, feedback: Payload) -> None:
        if self._listening:
            self._client.replies.send(
                ActionFeedback(action=self._name, values=feedback, id=self.id), self._fragment_size
            )

    def _on_result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        self.ended = True
        self._client.ended(self)
        if not self._listening:
            return
        failed = isinstance(outcome, CallFailed)
        self._client.replies.send(
            ActionResult(
                action=self._name,
                values=str(outcome) if isinstance(outcome, CallFailed) else outcome,
                status=int(status),
                result=not failed,
                reason=None if failed or self.goal is None else self.goal.reason or None,
                id=self.id,
            ),
            # A failure is short: an error text.
            None if failed else self._fragment_size,
        )


Accepted = tuple["ActionType", "ServerGoal"]


class _ProvidedAction(Provided[Accepted]):
    """Action that a client provides, with its active goals."""

    __slots__ = ("_type",)

    def __init__(self, op: AdvertiseAction, graph: ClientGraph, address: str, replies: Replies) -> None:
        super().__init__(op.action, graph, address, replies)
        self._type = op.type  # In the client's spelling: clients compare it.

    def take(self, type: ActionType, goal: ServerGoal) -> None:
        """Accept every goal and send it to the client under a new id (ACT-12, ACT-13)."""
        id_ = self._add("action_goal", (type, goal))
        goal.on_cancel = lambda: self._cancel(id_)
        goal.on_end = lambda _: self._end(id_)
        goal.accept()
        sent = self._replies.send(
            SendActionGoal(
                action=self._name,
                action_type=self._type,
                args=goal.goal,
                feedback=True,
                id=id_,
            )
        )
        if not sent:
            abort(type, goal, "the goal is too large for its server (limits.outgoing_message_bytes)")

    def _cancel(self, id_: str) -> None:
        self._replies.send(CancelActionGoal(action=self._name, id=id_))


def abort(type: ActionType, goal: ServerGoal, reason: str) -> None:
    """End a goal as aborted, with a result of defaults."""
    goal.finish(GoalStatus.ABORTED, Payload.from_json(type.result, b"{}"), reason)


class PeerActions:
    """Goals that one client sends, and actions that it provides."""

    __slots__ = ("_address", "_orphans", "_sent", "graph", "now", "provided", "replies")

    def __init__(
        self,
        graph: ClientGraph,
        replies: Replies,
        address: str,
        offers: Offers[Accepted],
        orphans: Orphans,
    ) -> None:
        self.graph = graph
        self.replies = replies
        self.now = graph.clock.time_ns  # ROS time.
        self._address = address
        self._orphans = orphans
        self._sent: set[PeerGoal] = set()
        self.provided = PeerOffers(graph, address, offers)

    @property
    def goals_running(self) -> int:
        """Goals of this client that wait for their result."""
        return len(self._sent)

    def send_goal(self, op: SendActionGoal) -> Steps:
        """Send a goal to an action of the graph (ACT-01 … ACT-05); a large one is checked in steps.

        Its type must exist (ACT-04) but may differ from the server's, because packages share actions under
        several names. The fields decide if the goal fits.
        """
        action = self.graph.action(split_suffix(op.action)[0]) if op.args.size >= IN_STEPS else None
        args: Payload | None = None
        if action is not None:
            args = yield from arguments_in_steps(action.type.goal, op.args, _GOAL, self.now)
        try:
            goal = PeerGoal(self, op, args)
        except ProviderNotFound as missing:
            raise Refused(str(missing)) from None
        if not goal.ended:
            self._sent.add(goal)

    def ended(self, goal: PeerGoal) -> None:
        """Remove a goal that has its result."""
        self._sent.discard(goal)
        self._orphans.discard(goal)

    def cancel(self, op: CancelActionGoal) -> None:
        """Cancel a goal by the id it was sent with, also from a new connection of the same address."""
        action = resolve(split_suffix(op.action)[0])
        for goal in self._sent:
            if goal.id == op.id and goal.action == action:
                if goal.goal is not None:
                    goal.goal.cancel()  # The outcome is the result (ACT-07, ACT-08).
                return
        orphan = self._orphans.find(self._address, action, op.id)
        if orphan is None:
            raise Refused(
                f"cancel_action_goal: no goal of {op.action} runs under id {op.id!r}", level="warning"
            )
        if orphan.goal is not None:
            self.graph.cancel_goal(action, orphan.goal.id)

    def advertise(self, op: AdvertiseAction) -> None:
        """Offer an action on the client's behalf, in place of any other of that name (ACT-12, ACT-18)."""
        provided = _ProvidedAction(op, self.graph, self._address, self.replies)
        self.graph.advertise_action(op.action, op.type, provided.take)
        self.provided.add(provided)

    def unadvertise(self, op: UnadvertiseAction) -> None:
        """Withdraw an action of this client; its running goals are aborted (ACT-18)."""
        if not self.graph.withdraw_action(op.action):
            raise Refused(f"unadvertise_action: this client does not advertise {op.action}", level="warning")
        self.provided.discard(resolve(op.action))

    def feedback(self, op: ActionFeedback) -> Steps:
        """Pass on the feedback of a client that offers the action (ACT-14); a large one in steps."""
        type, goal = self._goal(op.op, op.action, op.id)
        values = object_or_empty(op.values)
        if values.size < IN_STEPS:
            feedback = payload_of(type.feedback, values, _FEEDBACK, self.now)
        else:
            feedback = yield from payload_in_steps(type.feedback, values, _FEEDBACK, self.now)
            _, goal = self._goal(op.op, op.action, op.id)  # It may have ended meanwhile.
        goal.feedback(feedback)

    def result(self, op: ActionResult) -> Steps:
        """End a goal with the result of the client that offers the action (ACT-15, ACT-16); a large one is
        checked in steps."""
        type, goal = self._goal(op.op, op.action, op.id)
        if not op.result:
            abort(type, goal, failure_text(op.values, "the action failed and gave no reason"))
            return
        values = object_or_empty(op.values)
        try:
            if values.size < IN_STEPS:
                result = payload_of(type.result, values, _RESULT, self.now)
            else:
                result = yield from payload_in_steps(type.result, values, _RESULT, self.now)
        except Refused as refused:
            _, goal = self._goal(op.op, op.action, op.id)
            abort(type, goal, f"the provider's result does not fit {type.name}: {refused.reason}")
            raise
        _, goal = self._goal(op.op, op.action, op.id)  # It may have ended meanwhile.
        status = GoalStatus(op.status)
        try:
            goal.finish(status if status in _OUTCOMES else GoalStatus.ABORTED, result, op.reason or "")
        except InvalidTransition:
            # "canceled" without a cancel request: the state machine has no such step.
            goal.finish(GoalStatus.ABORTED, result, op.reason or "")

    def result_malformed(self, action: str, id: str | int | None, reason: str) -> None:
        """Abort the goal of an invalid result, so that its sender does not wait forever."""
        type, goal = self._goal("action_result", action, id)
        abort(type, goal, f"the provider's result is malformed: {reason}")

    def _goal(self, op: str, action: str, id: str | int | None) -> Accepted:
        return self.provided.pending(op, action, id, f"no goal of {action} runs")[str(id)]

    def close(self) -> Steps:
        """Let the goals continue; they can still be cancelled from the same address (ACT-19)."""
        yield from self.provided.close()
        for goal in tuple(self._sent):
            goal.orphan()
            self._orphans.add(goal, self._address, self.graph.holder)
            yield


HANDLERS: Final[Mapping[type[Op], Callable[[PeerActions, Never], Steps | None]]] = {
    SendActionGoal: PeerActions.send_goal,
    CancelActionGoal: PeerActions.cancel,
    ActionFeedback: PeerActions.feedback,
    ActionResult: PeerActions.result,
    AdvertiseAction: PeerActions.advertise,
    UnadvertiseAction: PeerActions.unadvertise,
}
