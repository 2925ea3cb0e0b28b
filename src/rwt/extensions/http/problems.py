"""Errors as problem details (RFC 9457): what failed, where, and what to do instead."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec

from rwt.access.client_graph import UnknownTopicType
from rwt.access.errors import (
    AccessError,
    GateRefused,
    NotAllowed,
    NotAuthenticated,
    OriginRefused,
    QuotaExceeded,
)
from rwt.access.graph_view import GraphView
from rwt.delivery.shared_publishers import IncompatiblePolicies
from rwt_graph.errors import InvalidGraphName, TypeConflict
from rwt_participant.errors import (
    CallFailed,
    CallTimeout,
    GoalRejected,
    InvalidMessage,
    NotFound,
    ParameterRejected,
    ProviderGone,
    RobotError,
    ServiceFailed,
    TimedOut,
    UnknownType,
)
from rwt_participant.spelling import did_you_mean
from rwt_transports.errors import Refused
from rwt_transports.http.routes import HttpRequest, HttpResponse
from rwt_transports.shared_pool import PoolFull

CONTENT_TYPE: Final = "application/problem+json"


class ProblemKind(NamedTuple):
    """Kind of problem: status, title, and remedy, for the page that explains it."""

    status: int
    title: str
    instead: str


_KINDS: Final = (
    (400, "invalid-request", "The request cannot be read", "correct what the detail names"),
    (400, "invalid-name", "Not a name that ROS allows", "names are like `odom` or `arm/state`"),
    (401, "not-authenticated", "Credentials are needed", "send `Authorization: Bearer TOKEN`"),
    (403, "not-allowed", "The role does not allow this", "ask for a role that does"),
    (
        403,
        "origin-refused",
        "Pages of this site may not do this",
        "list the site in `origins.allow` of the server",
    ),
    (403, "gate-refused", "A rule of the gate does not let this through", "do what the rule asks for"),
    (404, "not-found", "Nothing of that name is here", "the lists above it name what there is"),
    (404, "no-message", "No message is kept", "wait for the next one with `?wait=SECONDS`"),
    (405, "method-not-allowed", "Not possible here", "use one of the methods that `Allow` names"),
    (406, "not-acceptable", "Not in a form that was asked for", "accept application/json"),
    (409, "conflict", "In contradiction to what is here", "use the type and policies that are here"),
    (409, "goal-rejected", "The goal was rejected", "send another, or send it later"),
    (421, "misdirected", "Perhaps at another process", "ask again over another connection"),
    (413, "too-large", "More than may be sent", "send every field of the type, or less"),
    (
        415,
        "unsupported-media-type",
        "Not a form that is read here",
        "send application/json or application/cbor",
    ),
    (422, "invalid-message", "The body does not fit its type", "the document names the type's fields"),
    (422, "unknown-type", "No such type is known", "name one as `std_msgs/String`"),
    (422, "parameter-rejected", "The parameter cannot have that value", "send another value"),
    (429, "too-much", "As much as may be", "wait, or end something"),
    (502, "service-failed", "The service said that it failed", "its reason is in the detail"),
    (503, "no-room", "Other clients use all that there is", "try again later"),
    (503, "provider-gone", "The provider has gone away", "try again"),
    (504, "timeout", "Nothing came in time", "wait longer, with `?wait=` or `?timeout=`"),
)

KINDS: Final[Mapping[str, ProblemKind]] = MappingProxyType(
    {name: ProblemKind(status, title, instead) for status, name, title, instead in _KINDS}
)
"""Kinds of problems by the last part of their `type`."""

_OF_STATUS: Final[Mapping[int, str]] = {
    401: "not-authenticated",
    403: "not-allowed",
    429: "too-much",
    503: "no-room",
}

_OF_ERROR: Final[tuple[tuple[type[Exception], str], ...]] = (
    (NotAllowed, "not-allowed"),
    (GateRefused, "gate-refused"),
    (NotAuthenticated, "not-authenticated"),
    (QuotaExceeded, "too-much"),
    (InvalidGraphName, "invalid-name"),
    (TypeConflict, "conflict"),
    (IncompatiblePolicies, "conflict"),
    (UnknownTopicType, "not-found"),
    (UnknownType, "unknown-type"),
    (InvalidMessage, "invalid-message"),
    (ParameterRejected, "parameter-rejected"),
    (CallTimeout, "timeout"),
    (TimedOut, "timeout"),
    (ProviderGone, "provider-gone"),
    (GoalRejected, "goal-rejected"),
    (ServiceFailed, "service-failed"),
    (NotFound, "not-found"),
    (CallFailed, "service-failed"),
)
"""Kind of problem by error class; the first match counts."""


class HttpProblem(Exception):
    """Request that cannot be fulfilled.

    Attributes:
        kind: one of :data:`KINDS`.
        detail: what is wrong, and where.
        instead: remedy; by default that of the kind.
        where: faulty part of the request: a JSON Pointer into its body, or a query's name.
    """

    def __init__(
        self,
        kind: str,
        detail: str,
        *,
        instead: str = "",
        where: str = "",
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.kind = kind
        self.detail = detail
        self.instead = instead or KINDS[kind].instead
        self.where = where
        self.headers = headers or {}


class CallWaits(Exception):
    """The call waits for approval.

    Attributes:
        response: response with status 202.
    """

    def __init__(self, response: HttpResponse) -> None:
        super().__init__("the call waits for approval")
        self.response = response


REFUSALS: Final = (HttpProblem, RobotError, AccessError, PoolFull)
"""Exceptions of a page whose texts are sent to the client."""


def problem_of(error: Exception, reader: GraphView) -> HttpProblem:
    """Return the problem for one of :data:`REFUSALS`; names a similar topic that the reader sees."""
    if isinstance(error, HttpProblem):
        return error
    if isinstance(error, PoolFull):
        return HttpProblem("no-room", error.reason, headers=error.headers)
    # The table has classes before their bases.
    kind = next((kind for known, kind in _OF_ERROR if isinstance(error, known)), "invalid-request")
    where = _pointer(error.path) if isinstance(error, InvalidMessage) else ""
    meant = ""
    if isinstance(error, UnknownTopicType):
        # From what the reader sees: a suggestion must not reveal a hidden name.
        meant = did_you_mean(error.topic, (each.name for each in reader.topics()))
    return HttpProblem(kind, f"{error}{meant}", where=where)


def _pointer(path: str) -> str:
    """Return ``pose.covariance[3]`` as a JSON Pointer (RFC 6901), ``/pose/covariance/3``."""
    return "/" + path.replace("[", "/").replace("]", "").replace(".", "/") if path else ""


def answer(request: HttpRequest, problem: HttpProblem) -> HttpResponse:
    """Return the response with a problem."""
    status, title, _ = KINDS[problem.kind]
    body = {
        "type": f"{request.prefix}/api#{problem.kind}",
        "title": title,
        "status": status,
        "detail": problem.detail,
        "instead": problem.instead,
        "instance": request.prefix + request.path,
    }
    if problem.where:
        body["where"] = problem.where
    headers = {"Cache-Control": "no-store", **problem.headers}
    return HttpResponse(msgspec.json.encode(body), status, CONTENT_TYPE, headers)


def refusal(request: HttpRequest, refused: Refused) -> HttpResponse:
    """Return the response to a request that was refused before it reached its page."""
    of_status = _OF_STATUS.get(refused.status, "invalid-request")
    kind = "origin-refused" if isinstance(refused, OriginRefused) else of_status
    return answer(request, HttpProblem(kind, refused.reason, headers=refused.headers))
