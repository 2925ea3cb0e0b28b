"""Safety path of the gate: stop messages at once where clients drove, the rest in turns, one timer for all.

Nothing here waits for clients, and no exception of one receiver keeps the stop from the next.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.access.gate.topic import GuardedTopic
    from rwt_graph.clock import Clock
    from rwt_participant.timers import Timer

Cancel = Callable[[], "Iterator[None]"]
"""Function that returns the steps of cancelling all goals of an action."""

logger: Final = logging.getLogger("rwt.bridge")

REPEAT_SECONDS: Final = 0.1
"""Interval of the stop message while it is repeated, in seconds."""

#: Maximum number of topics, and of actions, that are stopped before anything else when the stop is pressed.
MAX_DRIVEN: Final = 64

#: Seconds of one turn, and number of steps, for stopping what nobody drove since the last stop.
_TURN_SECONDS: Final = 0.002
_TURN_STEPS: Final = 256


class StopPath:
    """Stop messages of one gate.

    Attributes by purpose:

    * Driven since the last stop, at most :data:`MAX_DRIVEN` each: ``_topics``, and ``_actions`` with the
      function that returns the steps of cancelling their goals.
    * Repetition: ``_repeated`` (topics whose stop message is repeated), ``_timer`` (None without any),
      ``_is_repeating`` (True until every topic has had its turn).
    * ``failed``: called with the name of what could not be stopped, and the error.
    """

    def __init__(self, clock: Clock, failed: Callable[[str, Exception], None]) -> None:
        self._clock = clock
        self._failed = failed
        self._topics: dict[GuardedTopic, None] = {}
        self._actions: dict[str, Cancel] = {}
        self._repeated: dict[GuardedTopic, None] = {}
        self._timer: Timer | None = None
        self._is_repeating = False

    # Driven since the last stop

    def note_topic(self, topic: GuardedTopic) -> None:
        """Note a topic that a client drives; beyond the limit it is stopped in turns.

        A topic with a lease takes the place of one without, which an attacker could have driven before.
        """
        if len(self._topics) >= MAX_DRIVEN:
            unheld = next((each for each in self._topics if not each.is_held), None)
            if unheld is None or not topic.is_held:
                return
            del self._topics[unheld]
        self._topics[topic] = None

    def forget_topic(self, topic: GuardedTopic) -> None:
        """Forget a topic that is closed."""
        self._topics.pop(topic, None)

    def note_goal(self, action: str, make_cancel: Callable[[], Cancel]) -> None:
        """Note an action to which a client sends goals.

        Args:
            make_cancel: returns the function that cancels its goals; called once, before it is needed.
        """
        if action not in self._actions and len(self._actions) < MAX_DRIVEN:
            self._actions[action] = make_cancel()

    # Stopping

    def press(self) -> None:
        """Stop what was driven since the last stop, held leases first; then goals, in turns."""
        topics = sorted(self._topics, key=lambda topic: not topic.is_held)
        actions = self._actions
        self._topics, self._actions = {}, {}
        for topic in topics:
            self.run(topic.name, topic.emergency_stop)
        self.in_turns(self.cancel_goals(actions))

    def cancel_goals(self, actions: Mapping[str, Cancel]) -> Iterator[None]:
        """Cancel goals, a step each: the oldest of each action, then the next.

        Many goals of one action thus do not delay the cancellation of another's.
        """
        pending: deque[tuple[str, Iterator[None]]] = deque()

        def begin(action: str, cancel: Cancel) -> None:
            pending.append((action, cancel()))

        def step(action: str, steps: Iterator[None]) -> None:
            for _ in steps:
                pending.append((action, steps))
                return

        for action, cancel in actions.items():
            self.run(action, partial(begin, action, cancel))
        while pending:
            action, steps = pending.popleft()
            self.run(action, partial(step, action, steps))
            yield

    def run(self, name: str, act: Callable[[], None]) -> None:
        """Run a step of stopping; its exception is reported and ends nothing else."""
        try:
            act()
        except Exception as error:
            logger.exception("the gate could not stop %s", name)
            self._failed(name, error)

    def in_turns(self, steps: Iterator[None]) -> None:
        """Take steps for a share of this turn, and the others in later turns."""
        until = self._clock.monotonic() + _TURN_SECONDS
        for count, _ in enumerate(steps, 1):
            if count >= _TURN_STEPS or self._clock.monotonic() > until:
                self._clock.call_later(0.0, partial(self.in_turns, steps))
                return

    # Repetition

    def repeat(self, topic: GuardedTopic) -> None:
        """Repeat the stop message of a topic while it wants that."""
        self._repeated[topic] = None
        if self._timer is None:
            self._timer = self._clock.call_urgently(REPEAT_SECONDS, self._repeat_all)

    def end_repeats(self, topic: GuardedTopic) -> None:
        """End the repetition for a topic; no-op if there is none."""
        self._repeated.pop(topic, None)

    def _repeat_all(self) -> None:
        self._timer = None
        if self._repeated:
            self._timer = self._clock.call_urgently(REPEAT_SECONDS, self._repeat_all)
            if not self._is_repeating:
                self.in_turns(self._repeat_each())

    def _repeat_each(self) -> Iterator[None]:
        self._is_repeating = True
        for topic in tuple(self._repeated):
            if topic in self._repeated:
                if topic.must_repeat():
                    self.run(topic.name, topic.publish_stop)
                else:
                    del self._repeated[topic]
            yield
        self._is_repeating = False

    def close(self) -> None:
        """Forget everything."""
        self._topics.clear()
        self._actions.clear()
        self._repeated.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
