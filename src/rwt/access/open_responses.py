"""Answers to requests that last, such as streams and peers: which may go on when settings have changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rwt.access.admission import Admission
    from rwt_transports.endpoint import PeerInfo

_GONE: Final = "the server's settings have changed, and do not allow this any more"


class _Answer(NamedTuple):
    info: PeerInfo
    topics: tuple[str, ...]
    end: Callable[[str], None]


class OpenResponses:
    """The answers that go on.

    Args:
        admission: who comes in, and as what.
    """

    def __init__(self, admission: Admission) -> None:
        self._admission = admission
        self._answers: dict[object, _Answer] = {}

    def add(self, info: PeerInfo, topics: Iterable[str], end: Callable[[str], None]) -> Callable[[], None]:
        """Register an open response, as :meth:`rwt_transports.http.routes.Reader.while_allowed` does."""
        answer = _Answer(info, tuple(topics), end)
        if reason := self._reason(answer):
            raise Refused(403, reason)
        key = object()
        self._answers[key] = answer

        def ended() -> None:
            self._answers.pop(key, None)

        return ended

    def review(self) -> None:
        """End those that the settings do not allow now."""
        for key, answer in tuple(self._answers.items()):
            if (reason := self._reason(answer)) and self._answers.pop(key, None) is not None:
                answer.end(reason)

    def _reason(self, answer: _Answer) -> str:
        """Why an answer may not go on; empty where it may."""
        try:
            role = self._admission.role_of(answer.info)
        except Refused as refused:
            return refused.reason
        if role is None:
            return _GONE
        refused_topics = (topic for topic in answer.topics if not role.allows("subscribe", topic))
        topic = next(refused_topics, None)
        return "" if topic is None else f"{_GONE}: role {role.name!r} may not subscribe to {topic}"
