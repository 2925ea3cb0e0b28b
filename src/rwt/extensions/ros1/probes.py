"""Questions to other nodes for types that no registration tells: of services, and of topics with type `*`."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final

import anyio

from rwt.extensions.ros1.wire.network import Unreachable
from rwt_graph.errors import Ros1Error, WireError

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.network import Network

#: Maximum types that are asked for at once, and questions that wait for that.
_MOST_PROBES: Final = 8
_MOST_WAITING: Final = 200

#: Seconds after which a node is asked again that has answered with a type that is not known here.
_UNKNOWN_TYPE_SECONDS: Final = 10.0

#: A node that gave no answer is asked again at the next reading. One that accepts connections and never
#: answers, or has answered with some errors, which it may log, is asked again after these seconds.
_FAILING_SECONDS: Final = 10.0
_SILENT_SECONDS: Final = 1.0
_QUICK_FAILURES: Final = 5

#: Question: "topic" or "service", its name, and the node that is asked.
Question = tuple[str, str, str]

Ask = Callable[[], Awaitable[None]]
"""Asks for a type and notes it.

Raises:
    UnusableType: it is not known here.
    Ros1Error: the node gave no answer.
    WireError: the answer is malformed.
"""


class UnusableType(Ros1Error):
    """A node has answered, and its type is not known here."""


@dataclass(slots=True)
class _Open:
    """Question without an answer.

    Attributes:
        asking: True while the node is asked.
        after: time from which the node may be asked.
        warned: text that was logged for it.
    """

    ask: Ask
    asking: bool = False
    after: float = 0.0
    warned: str = ""


@dataclass(slots=True)
class _Silent:
    """Node that gave no answer: one of its questions is asked at a time, until it answers one."""

    failures: int = 0
    failed_at: float = 0.0
    after: float = 0.0
    asking: bool = False

    def fail(self, began: float, error: Exception) -> None:
        """Note the failure of an attempt; those that were made at once count as one."""
        now = time.monotonic()
        if began >= self.failed_at:
            self.failures += 1
        self.failed_at = now
        is_refused = isinstance(error, Unreachable) or self.failures <= _QUICK_FAILURES
        self.after = now if is_refused and now - began < _SILENT_SECONDS else now + _FAILING_SECONDS


class Probes:
    """Open questions, each asked until it has an answer or the master's tables no longer list its subject.

    A question belongs to one listing of an endpoint: what leaves the tables and comes back is a new one.

    Args:
        warn_once: logs a text.
        withdraw_warning: lets a text be logged again, since its question has ended.
    """

    def __init__(
        self, network: Network, warn_once: Callable[[str], None], withdraw_warning: Callable[[str], None]
    ) -> None:
        self._network = network
        self._warn_once = warn_once
        self._withdraw_warning = withdraw_warning
        self._open: dict[Question, _Open] = {}
        self._silent: dict[str, _Silent] = {}
        self._limiter = anyio.CapacityLimiter(_MOST_PROBES)

    def replace(self, questions: Mapping[Question, Ask]) -> None:
        """Keep the open questions among these, drop all others, and add the new ones."""
        for key in self._open.keys() - questions.keys():
            self._end(key, self._open[key])
        for key, ask in questions.items():
            self._open.setdefault(key, _Open(ask))
        nodes = {node for _, _, node in self._open}
        self._silent = {node: state for node, state in self._silent.items() if node in nodes}

    def ask(self) -> None:
        """Ask every question that is due; called at each reading of the master's tables."""
        now = time.monotonic()
        room = _MOST_PROBES + _MOST_WAITING - sum(question.asking for question in self._open.values())
        for key, question in tuple(self._open.items()):
            if room <= 0:
                return
            silent = self._silent.get(key[2])
            is_held = silent is not None and (silent.asking or silent.after > now)
            if not question.asking and question.after <= now and not is_held:
                question.asking = True
                room -= 1
                if silent is not None:
                    silent.asking = True
                self._network.spawn(partial(self._ask, key, question), f"type of {key[1]}")

    async def _ask(self, key: Question, question: _Open) -> None:
        node = key[2]
        async with self._limiter:
            began = time.monotonic()
            try:
                await question.ask()
            except UnusableType as error:
                self._silent.pop(node, None)
                question.after = time.monotonic() + _UNKNOWN_TYPE_SECONDS
                self._report(question, error)
            except (Ros1Error, WireError) as error:
                self._silent.setdefault(node, _Silent()).fail(began, error)
                self._report(question, error)
            else:
                if self._open.get(key) is question:
                    self._end(key, question)
                if self._silent.pop(node, None) is not None:
                    self.ask()  # Its other questions, which were held back.
            finally:
                question.asking = False
                if node in self._silent:
                    self._silent[node].asking = False

    def _report(self, question: _Open, error: Exception) -> None:
        if not question.warned:
            question.warned = str(error)
            self._warn_once(question.warned)

    def _end(self, key: Question, question: _Open) -> None:
        del self._open[key]
        if question.warned:
            self._withdraw_warning(question.warned)
