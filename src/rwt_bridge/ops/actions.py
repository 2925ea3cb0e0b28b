"""The ops about actions: goals, cancels, feedback and results, both ways."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_access.quotas import require_advertisement, require_call
from rwt_bridge.ops.payloads import arguments_of, failure_text, object_or_empty, payload_of
from rwt_bridge.ops.services import split_suffix
from rwt_graph.api import GoalEvents
from rwt_graph.errors import InvalidTransition
from rwt_graph.names import resolve
from rwt_interfaces.payload import Payload
from rwt_program.errors import CallFailed
from rwt_program.goals import GoalStatus
from rwt_protocol.errors import Refused
from rwt_protocol.ops import ActionFeedback, ActionResult, CancelActionGoal, SendActionGoal

if TYPE_CHECKING:
    from rwt_bridge.peer import Peer
    from rwt_graph.api import ClientGoal, Registration, ServerGoal
    from rwt_interfaces.structs import ActionType
    from rwt_protocol import ops

_OUTCOMES = frozenset({GoalStatus.SUCCEEDED, GoalStatus.CANCELED})


class SentGoal:
    """One goal of a client, until its result."""

    def __init__(self, peer: Peer, op: SendActionGoal, goal: Payload) -> None:
        self._peer = peer
        self._op = op
        self._listening = True
        self.action = resolve(split_suffix(op.action)[0])
        events = GoalEvents(on_result=self._on_result, on_feedback=self._on_feedback if op.feedback else None)
        peer.goals.add(self)
        peer.bridge.ledger.goals += 1
        self._goal: ClientGoal = peer.bridge.participant.send_goal(self.action, goal, events)

    @property
    def id(self) -> str | int | None:
        """The id the client gave it."""
        return self._op.id

    def cancel(self) -> None:
        """Ask the server to cancel; the outcome is the result (ACT-07, ACT-08)."""
        self._goal.cancel()

    def orphan(self) -> None:
        """The client has gone; the goal runs on, and nobody hears of it (ACT-19)."""
        self._listening = False
        self._goal.want_feedback(False)

    def _on_feedback(self, feedback: Payload) -> None:
        if not self._listening:
            return
        op = self._op
        self._answer(ActionFeedback(action=op.action, values=feedback, id=op.id))

    def _answer(self, answer: ActionFeedback | ActionResult) -> None:
        self._peer.send_if_small(answer, self._op.fragment_size)

    def _on_result(self, status: GoalStatus, outcome: Payload | CallFailed) -> None:
        peer, op = self._peer, self._op
        peer.goals.discard(self)
        peer.bridge.forget_goal(self)
        if not self._listening:
            return
        if isinstance(outcome, CallFailed):
            peer.send(
                ActionResult(
                    action=op.action,
                    values=str(outcome),
                    status=int(status),
                    result=False,
                    id=op.id,
                )
            )
        else:
            self._answer(
                ActionResult(
                    action=op.action,
                    values=outcome,
                    status=int(status),
                    result=True,
                    id=op.id,
                )
            )


def on_send_action_goal(peer: Peer, op: SendActionGoal) -> None:
    """Send a goal to an action of the graph (ACT-01 … ACT-05).

    Its type must exist (ACT-04), and may be another than the server's: one action goes by several packages'
    names, and whether the goal fits is told by its fields.
    """
    name, suffix = split_suffix(op.action)
    if suffix is not None and op.id is None:
        op = op.model_copy(update={"id": suffix})
    action = resolve(name)
    peer.role.require("goals", action)
    info = peer.bridge.graph.action(action)
    if info is None:
        raise Refused(f"Action {action} does not exist")
    peer.bridge.graph.registry.action(op.action_type)
    require_call(peer, op.op)
    SentGoal(peer, op, arguments_of(info.type.goal, op.args, "send_action_goal.args", peer.bridge.now))


def on_cancel_action_goal(peer: Peer, op: ops.CancelActionGoal) -> None:
    """Cancel a goal by the id it was sent with.

    A client that has lost its connection may cancel from the next one: goals whose sender has disconnected
    are found by the address they came from.
    """
    action = resolve(split_suffix(op.action)[0])
    for goal in peer.goals:
        if goal.id == op.id and goal.action == action:
            goal.cancel()
            return
    peer.role.require("goals", action)
    orphan = peer.bridge.orphaned_goal(peer.info.address, action, op.id)
    if orphan is None:
        raise Refused(f"cancel_action_goal: no goal of {op.action} runs under id {op.id!r}", level="warning")
    orphan.cancel()


class ProvidedAction:
    """One action that a client offers, and the goals it works on."""

    def __init__(self, peer: Peer, name: str, type: ActionType) -> None:
        self._peer = peer
        self._name = name
        self._type = type
        self._count = 0
        self._goals: dict[str, ServerGoal] = {}
        self._registration: Registration = peer.bridge.participant.advertise_action(
            resolve(name), type, self._forward
        )

    def _forward(self, goal: ServerGoal) -> None:
        """Accept every goal and send it to the client under an id of its own (ACT-12, ACT-13)."""
        self._count += 1
        id_ = f"action_goal:{self._name}:{self._count}"
        self._goals[id_] = goal
        goal.on_cancel = lambda: self._peer.send(CancelActionGoal(action=self._name, id=id_))
        goal.on_end = lambda _: self._forget(id_)
        goal.accept()
        sent = self._peer.send_if_small(
            SendActionGoal(
                action=self._name,
                action_type=self._peer.bridge.graph.registry.type_name(self._type),
                args=goal.goal,
                feedback=True,
                id=id_,
            )
        )
        if not sent:
            reason = "the goal is too large for its server (limits.outgoing_message_bytes)"
            goal.finish(GoalStatus.ABORTED, Payload.from_json(self._type.result, b"{}"), reason)

    def _forget(self, id_: str) -> None:
        self._goals.pop(id_, None)

    def feedback(self, op: ops.ActionFeedback) -> None:
        """Pass feedback on (ACT-14)."""
        goal = self._goals.get(op.id) if isinstance(op.id, str) else None
        if goal is None:
            raise Refused(
                f"action_feedback: no goal of {self._name} runs under id {op.id!r}", level="warning"
            )
        values = object_or_empty(op.values)
        goal.feedback(
            payload_of(self._type.feedback, values, "action_feedback.values", self._peer.bridge.now)
        )

    def result(self, op: ops.ActionResult) -> None:
        """End a goal (ACT-15, ACT-16)."""
        goal = self._goals.pop(op.id, None) if isinstance(op.id, str) else None
        if goal is None:
            raise Refused(f"action_result: no goal of {self._name} runs under id {op.id!r}", level="warning")
        if not op.result:
            reason = failure_text(op.values, "the action failed and gave no reason")
            goal.finish(GoalStatus.ABORTED, Payload.from_json(self._type.result, b"{}"), reason)
            return
        try:
            values = object_or_empty(op.values)
            result = payload_of(self._type.result, values, "action_result.values", self._peer.bridge.now)
        except Refused as refused:
            reason = f"the provider's result does not fit {self._type.name}: {refused.reason}"
            goal.finish(GoalStatus.ABORTED, Payload.from_json(self._type.result, b"{}"), reason)
            raise
        self._finish(goal, GoalStatus(op.status), result)

    def _finish(self, goal: ServerGoal, status: GoalStatus, result: Payload) -> None:
        try:
            goal.finish(status if status in _OUTCOMES else GoalStatus.ABORTED, result)
        except InvalidTransition:
            # "canceled" without a cancel request: the state machine has no such step.
            goal.finish(GoalStatus.ABORTED, result)

    def close(self) -> None:
        """Withdraw the action; running goals are aborted (ACT-18, ACT-19)."""
        self._registration.close()
        self._goals.clear()


def on_advertise_action(peer: Peer, op: ops.AdvertiseAction) -> None:
    """Offer an action on the client's behalf, in place of any other of that name (ACT-12, ACT-18)."""
    name = resolve(op.action)
    peer.role.require("provide", name)
    action_type = peer.bridge.graph.registry.action(op.type)
    if name not in peer.actions:
        require_advertisement(peer, op.op)
    provided = ProvidedAction(peer, op.action, action_type)
    previous = peer.actions.pop(name, None)
    if previous is not None:
        previous.close()
    peer.actions[name] = provided


def on_unadvertise_action(peer: Peer, op: ops.UnadvertiseAction) -> None:
    """Withdraw an action of this client (ACT-18)."""
    provided = peer.actions.pop(resolve(op.action), None)
    if provided is None:
        raise Refused(f"unadvertise_action: this client does not advertise {op.action}", level="warning")
    provided.close()


def on_action_feedback(peer: Peer, op: ops.ActionFeedback) -> None:
    """Take feedback from the client that offers the action."""
    _provided(peer, op.op, op.action).feedback(op)


def on_action_result(peer: Peer, op: ops.ActionResult) -> None:
    """Take a result from the client that offers the action."""
    _provided(peer, op.op, op.action).result(op)


def _provided(peer: Peer, op: str, action: str) -> ProvidedAction:
    provided = peer.actions.get(resolve(action))
    if provided is None:
        raise Refused(f"{op}: this client does not advertise {action}")
    return provided
