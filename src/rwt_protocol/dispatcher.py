"""Dispatcher: calls the handler of an op, and reports exceptions to its sender."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, Generic, Never, TypeVar, cast

from rwt_protocol.errors import IncompleteDispatcher, Misread, Refused
from rwt_protocol.ops import OPS, Direction, Op, ReplyTo, inbound
from rwt_protocol.ops.light import LIGHT, LightOp

C = TypeVar("C")

Steps = Iterator[None]
"""Remaining work of a handler in short steps. The op ends with the last step."""

_Handler = tuple[Callable[[object, Op], Steps | None], Callable[..., object] | None]
"""Handler, and the function that returns its context; None: the context itself."""

INTERNAL_ERROR: Final = "internal error"
"""Error text for peers of exceptions other than `Refused`."""

_DONE: Final = object()


class Dispatcher(Generic[C]):
    """Table of handlers.

    Args:
        handlers: handler of each arriving op, by op type; called with the context of :meth:`dispatch` and the
            op. Handlers reject ops by raising `Refused`, and may return long work in steps, for `later`.
        on_error: called with the context, the op and any other exception, within the `except` block; must not
            raise.
        refusals: further exceptions that reject an op; their text goes to the peer.
        direction: which messages arrive here: `TO_SERVER` in a server, `TO_CLIENT` in a client.
        later: called with the context, the op and the steps of its handler, to run them by :meth:`go_on`;
            returns the result of :meth:`dispatch`. None: run all steps at once.
        parts: by op type, functions such as `operator.attrgetter("topics")` that return the part of the
            context with which the handler is called; other handlers are called with the context itself.

    Raises:
        IncompleteDispatcher: a handler is missing, or exists for an op that does not arrive.
    """

    def __init__(
        self,
        handlers: Mapping[type[Op], Callable[[C, Never], Steps | None]],
        on_error: Callable[[C, Op, Exception], None],
        refusals: tuple[type[Exception], ...] = (),
        direction: Direction = Direction.TO_SERVER,
        later: Callable[[C, Op, Steps], Op | None] | None = None,
        parts: Mapping[type[Op], Callable[[C], object]] | None = None,
    ) -> None:
        expected = inbound(direction)
        missing, extra = expected - set(handlers), set(handlers) - expected
        if missing or extra:
            raise IncompleteDispatcher(_disagreement(missing, extra, direction))
        # Each handler accepts the type of its key, which a mapping's type cannot express.
        self._handlers: dict[type[Op | LightOp], _Handler] = {
            model: (cast("Callable[[object, Op], Steps | None]", handler), (parts or {}).get(model))
            for model, handler in handlers.items()
        }
        self._handlers |= {LIGHT[model]: self._handlers[model] for model in LIGHT if model in self._handlers}
        self._on_error = on_error
        self._refusals = refusals
        self._later = later

    def dispatch(self, context: C, op: Op) -> Op | None:
        """Run the handler of `op`, which must come from `Session.decode`.

        Returns:
            None, or the op that reports the rejection to the sender.

        Raises:
            Misread: a light op stands for another frame, and its handler has done nothing.
        """
        try:
            handler, part = self._handlers[type(op)]
            steps = handler(context if part is None else part(context), op)
            # Most ops take one step, which needs no further calls.
            if steps is None or next(steps, _DONE) is _DONE:
                return None
        except Misread:
            raise
        except Exception as error:
            return self.refused(context, op, error)
        return (self._later or self._at_once)(context, op, steps)

    def _at_once(self, context: C, op: Op, steps: Steps) -> Op | None:
        left = self.go_on(context, op, steps, lambda: True)
        return left if isinstance(left, Op) else None

    def go_on(self, context: C, op: Op, steps: Steps, may_go_on: Callable[[], bool]) -> Op | Steps | None:
        """Run at least one step of an op, and more while `may_go_on` returns True.

        Returns:
            The remaining steps, if any; otherwise the result of :meth:`dispatch`.
        """
        try:
            for _ in steps:
                if not may_go_on():
                    return steps
        except Exception as error:
            return self.refused(context, op, error)
        return None

    def refused(self, context: C, op: Op, error: Exception) -> Op:
        """Return the op that reports the current exception to the sender; call within the `except` block."""
        refuse = OPS[op.op].refuse
        if isinstance(error, Refused):
            return refuse(ReplyTo.of(op), error.reason, error.level)
        if isinstance(error, self._refusals):
            return refuse(ReplyTo.of(op), f"{op.op}: {error}", "error")
        self._on_error(context, op, error)
        return refuse(ReplyTo.of(op), INTERNAL_ERROR, "error")


def _disagreement(missing: frozenset[type[Op]], extra: set[type[Op]], direction: Direction) -> str:
    parts = [
        f"{text} {', '.join(sorted(model.__name__ for model in models))}"
        for text, models in (("no handler for", missing), ("a handler, but no such message, for", extra))
        if models
    ]
    return f"{direction.value}: {'; '.join(parts)}"
