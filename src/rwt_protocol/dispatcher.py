"""From an op to its handler, and from an exception to the op that reports it to the sender."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, Generic, Never, TypeVar, cast

from rwt_protocol.errors import IncompleteDispatcher, Refused
from rwt_protocol.ops import SPEC_OF, Direction, Op, ReplyTo, inbound

C = TypeVar("C")

INTERNAL_ERROR: Final = "internal error"
"""What a peer hears of an exception that is not a `Refused`."""


class Dispatcher(Generic[C]):
    """The table of handlers.

    Args:
        handlers: a handler for each op that may arrive, by the op's type: called with the context that
            :meth:`dispatch` was given, and the op. It refuses by raising `Refused`.
        on_error: called with the context, the op and any other exception, within the `except` block; it must
            not raise.
        refusals: exceptions that refuse, of layers that know no ops; their text goes to the peer.
        direction: which messages arrive here: `TO_SERVER` in a server, `TO_CLIENT` in a client.

    Raises:
        IncompleteDispatcher: a handler is missing, or is there for something that does not arrive.
    """

    __slots__ = ("_handlers", "_on_error", "_refusals")

    def __init__(
        self,
        handlers: Mapping[type[Op], Callable[[C, Never], None]],
        on_error: Callable[[C, Op, Exception], None],
        refusals: tuple[type[Exception], ...] = (),
        direction: Direction = Direction.TO_SERVER,
    ) -> None:
        expected = inbound(direction)
        missing, extra = expected - set(handlers), set(handlers) - expected
        if missing or extra:
            raise IncompleteDispatcher(_disagreement(missing, extra, direction))
        # Each handler takes the type that it is filed under, which a mapping's type cannot say.
        self._handlers = {
            model: cast("Callable[[C, Op], None]", handler) for model, handler in handlers.items()
        }
        self._on_error = on_error
        self._refusals = refusals

    def dispatch(self, context: C, op: Op) -> Op | None:
        """Run the handler of `op`, which is one that `Session.decode` gave.

        Returns:
            None, or the op that reports the refusal to the sender.
        """
        try:
            self._handlers[type(op)](context, op)
        except Refused as refused:
            return SPEC_OF[type(op)].refuse(ReplyTo.of(op), refused.reason, refused.level)
        except self._refusals as refused:
            return SPEC_OF[type(op)].refuse(ReplyTo.of(op), f"{op.op}: {refused}", "error")
        except Exception as error:
            self._on_error(context, op, error)
            return SPEC_OF[type(op)].refuse(ReplyTo.of(op), INTERNAL_ERROR, "error")
        return None


def _disagreement(missing: frozenset[type[Op]], extra: set[type[Op]], direction: Direction) -> str:
    parts = [
        f"{text} {', '.join(sorted(model.__name__ for model in models))}"
        for text, models in (("no handler for", missing), ("a handler, but no such message, for", extra))
        if models
    ]
    return f"{direction.value}: {'; '.join(parts)}"
