"""Action server of this process, as the services and topics of ROS 2.

Other processes see three services (send a goal, cancel goals, get a result), a topic of feedback and a
latched one of states. The topics include the goals of local clients.
"""

from __future__ import annotations

from collections import OrderedDict
from functools import partial
from typing import Any

from rwt_graph.accounts import hold_for_asker
from rwt_graph.actions.names import ActionNames, struct_payload, uuid_struct
from rwt_graph.api import GoalEvents, Participant, ServiceCall
from rwt_graph.clock import Clock
from rwt_graph.memory.actions import Actions, MemoryActionServer, cancel_service
from rwt_graph.memory.tables import NodeResources, displace
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, GoalRejected
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import LATCHED

#: Maximum number of results kept for clients that ask after the goal has ended.
RESULTS_KEPT = 100


class Ros2ActionServer:
    """Services and topics of one action; they exist as long as its server."""

    def __init__(
        self, participant: Participant, server: MemoryActionServer, actions: Actions, clock: Clock
    ) -> None:
        self._server = server
        self._actions = actions
        self._clock = clock
        self._clients = NodeResources(server.node)
        self._stamps: dict[str, dict[str, int]] = {}
        self._results: OrderedDict[str, tuple[GoalStatus, Payload]] = OrderedDict()
        self._waiting: dict[str, list[ServiceCall]] = {}
        self._advertise(participant)
        server.watcher = self

    def _advertise(self, participant: Participant) -> None:
        names, registry = ActionNames(self._server.name), self._server.type.goal.registry
        message, service = registry.message, registry.service
        self._feedback = participant.advertise(
            names.feedback, message(f"{self._server.type.name}_FeedbackMessage")
        )
        self._status = participant.advertise(names.status, message("action_msgs/GoalStatusArray"), LATCHED)
        self._reasons = participant.advertise(names.reasons, message("std_msgs/String"))
        cancel = service("action_msgs/CancelGoal")
        self._result_type = service(f"{self._server.type.name}_GetResult").response
        send = service(f"{self._server.type.name}_SendGoal")
        self._answer_type = send.response
        # The goal service is last: clients that see it rely on the others.
        self._services = (
            participant.advertise_service(names.cancel_goal, cancel, cancel_service(self._server, cancel)),
            participant.advertise_service(
                names.get_result, service(f"{self._server.type.name}_GetResult"), self._on_get_result
            ),
            participant.advertise_service(names.send_goal, send, self._on_send_goal),
        )
        if self._server.owner.for_clients:
            # A client's action ends as a whole if the robot uses a part of it.
            for part in (self._feedback, self._status, self._reasons, *self._services):
                part.on_displaced = partial(displace, self._server)

    def close(self) -> None:
        """Withdraw the services and topics; open calls for a result end with :exc:`ProviderGone`."""
        self._server.watcher = None
        for service in reversed(self._services):
            service.close()
        for publisher in (self._feedback, self._status, self._reasons):
            publisher.close()

    # Requests

    def _on_send_goal(self, call: ServiceCall) -> None:
        request: Any = call.request.value()
        goal_id = bytes(request.goal_id.uuid).hex()
        goal = Payload.from_value(self._server.type.goal, request.goal)
        asked = [call]
        try:
            release = hold_for_asker(0)
        except CallFailed as failed:
            call.fail(str(failed))
            return

        # The call holds the goal's message, so it is dropped with the answer: the goal may run without end.
        def accepted() -> None:
            stamp = self._stamps.get(goal_id) or self._now()
            asked.pop().reply(Payload.from_value(self._answer_type, {"accepted": True, "stamp": stamp}))

        def ended(_status: GoalStatus, outcome: Payload | CallFailed) -> None:
            release()
            if asked and isinstance(outcome, GoalRejected):
                self._give_reason(goal_id, str(outcome))
                asked.pop().reply(Payload.from_value(self._answer_type, {}))

        del call
        events = GoalEvents(ended, None, accepted)
        self._actions.send_here(self._server, goal, events, goal_id, self._clients)

    def _on_get_result(self, call: ServiceCall) -> None:
        request: Any = call.request.value()
        goal_id = bytes(request.goal_id.uuid).hex()
        if goal_id in self._results:
            self._give_result(call, *self._results[goal_id])
        elif goal_id in self._server.goals:
            waiting = self._waiting.setdefault(goal_id, [])
            waiting.append(call)
            call.on_end = lambda: waiting.remove(call)
        else:
            nothing = Payload.from_value(self._server.type.result, {})
            self._give_result(call, GoalStatus.UNKNOWN, nothing)

    def _give_result(self, call: ServiceCall, status: GoalStatus, result: Payload) -> None:
        call.reply(struct_payload(self._result_type, status=int(status), result=result.value()))

    # Topics

    def changed(self, goal_id: str) -> None:
        """Publish the states of all goals that have not ended, and of the one that changed."""
        self._stamps.setdefault(goal_id, self._now())
        states = [
            {
                "goal_info": {"goal_id": {"uuid": bytes.fromhex(id_)}, "stamp": self._stamps.get(id_, {})},
                "status": int(goal.status),
            }
            for id_, goal in self._server.goals.items()
            if goal.status is not GoalStatus.UNKNOWN
        ]
        self._status.publish(Payload.from_value(self._status.type, {"status_list": states}))

    @property
    def feedback_wanted(self) -> bool:
        return bool(self._feedback.subscriber_count)

    def fed_back(self, goal_id: str, feedback: Payload) -> None:
        if self.feedback_wanted:
            type = self._feedback.type
            uuid = uuid_struct(type, goal_id)
            self._feedback.publish(struct_payload(type, goal_id=uuid, feedback=feedback.value()))

    def ended(self, goal_id: str, status: GoalStatus, result: Payload | None, reason: str) -> None:
        """Answer the open calls for the result, and keep it for later ones."""
        self._stamps.pop(goal_id, None)
        waiting = self._waiting.pop(goal_id, [])
        if result is None:
            return
        self._give_reason(goal_id, reason)
        self._results[goal_id] = (status, result.detach())
        while len(self._results) > RESULTS_KEPT:
            self._results.popitem(last=False)
        for call in tuple(waiting):
            self._give_result(call, status, result)

    def _give_reason(self, goal_id: str, reason: str) -> None:
        if reason and self._reasons.subscriber_count:
            self._reasons.publish(Payload.from_value(self._reasons.type, {"data": f"{goal_id} {reason}"}))

    def _now(self) -> dict[str, int]:
        return self._server.type.goal.registry.distro.time(self._clock.time_ns())
