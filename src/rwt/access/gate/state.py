"""State that a gate shares with its topics: graph access, audit, approvals and the emergency stop."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from rwt.access.errors import GateRefused
from rwt.access.gate.approvals import Approvals
from rwt.access.gate.lease import WakeWatch
from rwt.access.gate.record import Recorder
from rwt.access.gate.stop_path import StopPath

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.audit import Audit
    from rwt.access.gate.fields import Clamped
    from rwt.access.gate.lease import Lease
    from rwt.access.gate.record import Actor
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt.access.settings import GateSettings
    from rwt_graph.api import Graph
    from rwt_interfaces.payload import Payload

MAX_LEASES: Final = 64
"""Maximum number of leases held by the clients of one credential, or of one address without credentials."""

GATE_NODE: Final = "/gate"
"""Node as which the gate publishes stop messages and its own state."""


class GateState:
    """State that a gate shares with its topics.

    The emergency stop is released or pressed: ``stopped_by`` names who pressed it, and is empty while it is
    released. In mode ``observe`` a press publishes the stop messages, and is released at once.

    Attributes by purpose:

    * Environment: ``settings``, ``is_observing``, ``clock``, ``participant``, ``recorder``.
    * Emergency stop: ``stop_path``, ``presses``, ``faults``, ``stopped_by``, and of its last change
      ``last_by``, ``stopped_reason``, ``stopped_ns``.
    * Leases: ``leases_held``, ``held``, ``wake_watch``.
    * Human approval: ``approvals``.
    * Listeners, set by the gate's node: ``on_leases``, ``on_stop``, ``on_approvals``.

    Attributes:
        settings: settings of the gate.
        is_observing: True if the gate only records what it would reject.
        clock: clock of the graph.
        participant: the gate's node in the graph.
        recorder: record of what happens.
        approvals: requests for approval.
        stop_path: stop messages of all topics.
        presses: number of times that the emergency stop was pressed.
        faults: topics that cannot be stopped, with the reason.
        leases_held: number of leases by identity, see :attr:`rwt.access.gate.record.Actor.owner`.
        held: the same leases, with the names of their topics.
        wake_watch: ends them after a suspension of the machine.
        stopped_by: client or program that pressed the emergency stop; empty while it is released.
        stopped_reason: reason for the last press or release, in the words of the client.
        stopped_ns: ROS time of the last press or release.
        last_by: client or program that pressed or released the stop last.
        on_leases, on_stop, on_approvals: called after a change.

    Args:
        graph: graph of the robot.
        settings: settings of the gate.
        audit: log of the server.

    Raises:
        OSError: the audit file cannot be opened.
    """

    def __init__(self, graph: Graph, settings: GateSettings, audit: Audit) -> None:
        self.settings = settings
        self.is_observing = settings.mode == "observe"
        self.clock = graph.clock
        self.recorder = Recorder(settings.audit, audit, graph.clock)
        self.participant = graph.participant(GATE_NODE)
        self.approvals = Approvals(graph.clock, self.recorder, self._approvals_changed)
        self.stop_path = StopPath(graph.clock, self._not_stopped)
        self.presses = 0
        self.faults: dict[str, str] = {}
        self.leases_held: Counter[str] = Counter()
        self.held: dict[Lease, str] = {}
        self.wake_watch = WakeWatch(graph.clock, self._look)
        self.stopped_by = ""
        self.stopped_reason = ""
        self.stopped_ns = graph.clock.time_ns()
        self.last_by = ""
        self.on_leases: Callable[[], None] | None = None
        self.on_stop: Callable[[], None] | None = None
        self.on_approvals: Callable[[], None] | None = None

    def require_released(self, rule: Rule) -> None:
        """Check that the emergency stop does not forbid what a rule is for.

        Raises:
            GateRefused: it is pressed, and the rule names it.
        """
        if self.stopped_by and rule.settings.emergency:
            raise GateRefused(
                f"the emergency stop is on: stopped by {self.stopped_by}", f"{rule.key}.emergency"
            )

    def require_approval(
        self, topic: str, rule: Rule, client: Actor, payload: Payload, *, is_stop: bool = False
    ) -> None:
        """Use up the approval for a message, or request one.

        Args:
            topic: absolute name of the topic.
            rule: rule that requires approval.
            client: client that publishes.
            payload: message as it will reach the robot.
            is_stop: True for the stop message, which needs none while another message is approved.

        Raises:
            GateRefused: the message is not approved yet.
        """
        approvals = self.approvals
        subject = approvals.subject(client, "publish", topic, rule, payload)
        if approvals.take(subject) or (is_stop and approvals.has_lasting(subject)):
            return
        text = f"publishing on {topic} needs a person's yes"
        if not self.is_observing:
            request = approvals.find(subject)
            if request is not None and request.subject != subject:
                text += f", and another message waits for it under id {request.id}"
            else:
                request = request or approvals.ask(subject, rule, payload)
                text += f", which was asked for under id {request.id}: send it again when it is there"
        raise GateRefused(text, f"{rule.key}.approval")

    def note_clamped(self, client: Actor, act: GatedAct, name: str, clamped: Clamped, key: str) -> None:
        """Record what was clamped, and tell the client.

        Args:
            client: client that acts.
            act: act with the message.
            name: name of the topic, service or action.
            clamped: numbers that were changed.
            key: key of the rule.
        """
        text = str(clamped)
        self.recorder.note(
            "changed", act, name, client, text, key, before=clamped.before, after=clamped.after
        )
        if client.on_notice is not None and not self.is_observing:
            client.on_notice(f"{act} {name}: {text} ({key})")

    def _not_stopped(self, name: str, error: Exception) -> None:
        text = f"{type(error).__name__}: {error}"
        if self.faults.get(name) != text:  # Recorded once: the stop message is repeated.
            self.faults[name] = text
            self.recorder.note("stop", "stop", name, None, f"not stopped: {text}")

    def require_lease_room(self, client: Actor) -> None:
        """Check that a client may hold one more lease: all leases may end at the same time.

        Raises:
            GateRefused: clients of its credential hold the maximum.
        """
        if self.leases_held[client.owner] >= MAX_LEASES:
            raise GateRefused(f"clients of this credential hold {MAX_LEASES} leases, which is the limit")

    def _look(self, was_suspended: bool) -> bool:
        if was_suspended:
            for lease in tuple(self.held):
                lease.check_silence()
        return bool(self.held)

    def leases_changed(self) -> None:
        """Report that a lease has another holder."""
        if self.on_leases is not None:
            self.on_leases()

    def _approvals_changed(self) -> None:
        if self.on_approvals is not None:
            self.on_approvals()
