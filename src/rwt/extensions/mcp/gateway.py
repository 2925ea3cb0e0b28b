"""The gateway: agents at `/mcp`, on the server's port, each with the role of its token."""

from __future__ import annotations

import html
import json
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio
import anyio.to_thread
import msgspec
from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import AccessToken
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp_types import CLIENT_INFO_META_KEY
from mcp_types.version import HANDSHAKE_PROTOCOL_VERSIONS
from pydantic import ValidationError

from rwt.access.audit import LineRate, is_written, one_line
from rwt.access.decisions import READS
from rwt.access.errors import AccessError
from rwt.access.graph_view import STOP, GraphView
from rwt.access.roles import Role, glob_pattern
from rwt.access.settings import LINGER_SECONDS
from rwt.extensions.mcp.agent import Act, Agent, Allow, note_once
from rwt.extensions.mcp.asgi import AgentExchange
from rwt.extensions.mcp.client_robot import ClientRobot
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.goals import GoalTable
from rwt.extensions.mcp.person import Questions
from rwt.extensions.mcp.server import make_server
from rwt.extensions.mcp.tools import TOOLS
from rwt.extensions.mcp.tools.acting import CallServiceArguments, PublishArguments
from rwt.gateways.base import Gateway
from rwt.gateways.early_look import may_name_stop
from rwt.gateways.visitors import Visitor, Visitors, peer_of, url_of
from rwt.observability.build import version
from rwt_participant.errors import RobotError
from rwt_participant.messages import to_payload
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import network_of
from rwt_transports.http.routes import (
    Audience,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    MetricFamily,
    Route,
    StopRequests,
    is_local,
)

if TYPE_CHECKING:
    from anyio.abc import TaskGroup
    from mcp.server.context import ServerRequestContext

    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.access.gate.approvals import Approval
    from rwt.access.gate.gate import Gate
    from rwt.extensions.mcp.content.answer import Answer
    from rwt.extensions.mcp.recordings import RecordingFolder
    from rwt.extensions.mcp.settings import McpSettings
    from rwt_graph.api import Graph
    from rwt_transports.endpoint import PeerInfo

logger = logging.getLogger(__name__)

PATH: Final = "/mcp"
"""Path at which agents are served."""

NODE: Final = "/mcp"
"""Absolute name of the node as which all agents act."""

#: Seconds that an approval outlasts its command, so that the robot can be stopped at the end.
_STOP_SECONDS: Final = 2.0

#: Maximum number of threads that encode images and long texts.
_THREADS: Final = 4

_HOW_TO_ACT: Final = "give it a role that may: `mcp.default_role`, or a token of `auth.tokens`"

#: Key of the sender in the scope of each request.
_CALLER: Final = "rwt.caller"


@dataclass(eq=False, slots=True)
class _Caller:
    """Sender of one request, until the response is complete or abandoned.

    Attributes:
        role: role by its token, or that of agents without a token. May change while the request is served.
        is_stream: True if the request only opens a stream of events, and for a subscription of its session.
        has_pressed_stop: True if the request has pressed the emergency stop.
        at_end: callbacks that cancel the request's work, called when the reader has disconnected.
    """

    info: PeerInfo
    role: Role
    is_stream: bool = False
    has_pressed_stop: bool = False
    at_end: list[Callable[[], object]] = field(default_factory=list)
    clients: set[ClientGraph] = field(default_factory=set)

    @property
    def owner(self) -> str:
        """Identity of the agent: agents of one credential and role at one address count as one."""
        return f"{self.role.credential}:{self.role.name}@{network_of(self.info.address)}"

    def leave(self) -> None:
        """Cancel the work of the request."""
        for end in self.at_end:
            end()


@dataclass(slots=True)
class _Session:
    """Session of an older protocol version; the SDK ends it after `mcp.session_idle_seconds`.

    Attributes:
        used_at: monotonic time at which a request of it last ended.
        program: name that the agent's program reports.
    """

    network: str
    used_at: float
    program: str
    under_way: int = 0


class McpGateway(Gateway):
    """Agents over the Model Context Protocol, as the node `/mcp`. Needs the extra `mcp`.

    Attributes by purpose:

    * Requests that are being answered: ``_callers``; ``_visitors`` counts the agents behind them as clients.
    * Sessions of older protocol versions: ``_sessions``, and the SDK's own in ``_manager``.
    * Running: ``_tasks`` and ``_is_up`` (set once the SDK's manager runs), ``_threads``.
    * Counters and log: ``_tool_calls``, ``_refused``, ``_log_rate``.
    * What agents have: ``_goals``, ``questions`` (to the person at the agent's program), ``_recordings``.

    Args:
        several_processes: True if other processes serve the same port. Then no session is kept, because the
            next request may reach another process.
    """

    name = "mcp"
    verbs = ("advertise", "publisher", *READS, "send_goal", "cancel_goal")

    def __init__(
        self,
        graph: Graph,
        access: Access,
        settings: McpSettings,
        recordings: RecordingFolder | None = None,
        *,
        several_processes: bool = False,
    ) -> None:
        super().__init__(graph, access, NODE, LINGER_SECONDS)
        self.settings = settings
        self._recordings = recordings
        self._visitors: Visitors[Visitor] = Visitors(self.shared.counters, graph.clock, LINGER_SECONDS)
        self._goals = GoalTable(settings.goals, several_processes=several_processes)
        self._callers: set[_Caller] = set()
        self._sessions: dict[str, _Session] = {}
        self._tool_calls: dict[tuple[str, str], int] = {}
        self._refused = 0
        self._log_rate = LineRate(per_second=10, burst=100)
        self._threads: anyio.CapacityLimiter | None = None
        self._tasks: TaskGroup | None = None
        self._is_up = anyio.Event()
        self.questions = Questions()
        self._keeps_sessions = not several_processes
        self._manager = StreamableHTTPSessionManager(
            make_server(self, version(), keeps_sessions=not several_processes),
            stateless=several_processes,
            session_idle_timeout=settings.session_idle_seconds,
            max_sessions=settings.sessions,
        )
        stop = StopRequests(self._may_press, self._press_stop)
        self.http = HttpExtension(
            tuple(
                Route(PATH, self._page, Audience.ADMITTED, method, stop=stop)
                for method in ("POST", "GET", "DELETE")
            ),
            self._section,
            self._metrics,
        )
        graph.spawn(self._run, "mcp")

    async def _run(self) -> None:
        self._threads = anyio.CapacityLimiter(_THREADS)
        async with self._manager.run(), anyio.create_task_group() as tasks:
            self._tasks = tasks
            self._is_up.set()
            await anyio.sleep_forever()

    def reload_roles(self) -> None:
        """Apply the current roles to the agents being served; end the requests of those not admitted."""
        super().reload_roles()
        for caller in tuple(self._callers):
            try:
                caller.role = self._role(caller.info)
            except Refused:
                caller.leave()
                continue
            for client in caller.clients:
                client.take_role(caller.role)
                client.withdraw_refused()

    def close(self) -> None:
        """End all sessions and leave the graph."""
        for caller in tuple(self._callers):
            caller.leave()
        if self._tasks is not None:
            self._tasks.cancel_scope.cancel()
        self._visitors.close()
        super().close()

    # -- requests --------------------------------------------------------------------------------------------

    def _may_press(self, request: HttpRequest, reader: GraphView) -> bool:
        """Return True if a request may press the emergency stop, see :class:`StopRequests`."""
        if request.method != "POST" or not may_name_stop(request.body):
            return False
        try:
            return self.access.is_stop_due(self._role(peer_of(request)))
        except Refused:
            return False

    def _press_stop(self, request: HttpRequest, reader: GraphView) -> None:
        """Press the emergency stop before the SDK reads the request, for which it needs several turns.

        The tool's call follows: it has the same response while the robot is stopped, and reports errors.
        """
        try:
            call = msgspec.json.decode(request.body, type=_ToolCall)
        except (msgspec.DecodeError, UnicodeDecodeError):  # The SDK accepts more texts than msgspec.
            return
        params = call.params
        tool = TOOLS.get(params.name)
        if call.method != "tools/call" or tool is None or not tool.is_for_stop(params.arguments):
            return
        session = self._sessions.get(request.headers.get("mcp-session-id", ""))
        reported = "" if params.meta is None else params.meta.program.name
        program = reported if session is None else session.program
        info = peer_of(request)
        client = self.access.client(self.shared, self._role(info), info.address, f"mcp:{_shortened(program)}")
        # The tool's call reports wrong arguments, and rejections by the gate.
        with suppress(ValidationError, RobotError, AccessError):
            asked = tool.arguments.model_validate(params.arguments)
            now = client.clock.time_ns
            if isinstance(asked, PublishArguments):
                publisher = client.publisher(STOP, None)
                publisher.publish(to_payload(publisher.type, asked.message, now))
            elif isinstance(asked, CallServiceArguments):
                message = asked.request
                client.call_service(STOP, lambda type: to_payload(type, message, now), lambda response: None)
        client.close()

    def _page(self, request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        info = peer_of(request)
        try:
            role = self._role(info)
            # A request that has stopped the robot is never refused for lack of room.
            if not reader.has_pressed_stop:
                self._check_room(request)
        except Refused as refused:
            self._refused += 1
            return _refusal(refused)
        return self._answer(request, reader, info, role)

    async def _answer(
        self, request: HttpRequest, reader: GraphView, info: PeerInfo, role: Role
    ) -> HttpResponse:
        await self._is_up.wait()
        if self._tasks is None:
            return _refusal(Refused(503, "this server is closing"))
        caller = _Caller(info, role, request.method == "GET", reader.has_pressed_stop)
        self._callers.add(caller)
        visitor = self._visitors.find(caller.owner, Visitor)
        visitor.hold()
        session = self._sessions.get(request.headers.get("mcp-session-id", ""))
        if session is not None:
            session.under_way += 1
        # Bound to its owner: a session's id alone does not authorise its use.
        user = AuthenticatedUser(AccessToken(token="", client_id=caller.owner, scopes=[]))
        exchange = AgentExchange(
            self._manager.asgi_app,
            request,
            {_CALLER: caller, "user": user},
            caller.leave,
            partial(self._left, caller, visitor, session),
            partial(reader.work.add, kind="pages"),
            has_head=self._keeps_sessions and _opens_session(request),
        )
        answer = await exchange.respond(self._tasks)
        self._note_session(request, answer, caller)
        return answer

    def _role(self, info: PeerInfo) -> Role:
        """Return the role of an agent: that of its token, or else `mcp.default_role`.

        Raises:
            Refused: it has no token, and the server admits no client without one.
        """
        admission = self.access.admission
        role = admission.role_of_token(info)
        # `auth.default_role` decides only whether clients need a token; the role itself is that for agents.
        if role is None and admission.default_role is not None:
            role = admission.roles.get(self.settings.default_role)
        if role is None:
            raise Refused(401, "agents need a bearer token here (auth.tokens)")
        return role

    def _check_room(self, request: HttpRequest) -> None:
        settings, network = self.settings, network_of(request.address)
        most = settings.request_bytes // 16 if _opens_session(request) else settings.request_bytes
        if len(request.body) > most:
            text = f"a request of {len(request.body)} bytes; the limit is {most} here (mcp.request_bytes)"
            raise Refused(413, text)
        if request.method == "GET":
            return  # One per session, and the number of sessions is limited.
        posted = [each for each in self._callers if not each.is_stream]
        if len(posted) >= settings.requests:
            text = f"{len(posted)} requests of agents are under way (mcp.requests)"
            raise Refused(503, text, {"Retry-After": "1"})
        # All programs on this machine share one address, so limits per address do not apply to them.
        if is_local(request.address):
            return
        own = sum(network_of(each.info.address) == network for each in posted)
        if own >= settings.requests_per_address:
            text = f"{own} requests of this address are under way (mcp.requests_per_address)"
            raise Refused(429, text, {"Retry-After": "1"})
        if _opens_session(request):
            self._forget_ended_sessions()
            open_now = sum(each.network == network for each in self._sessions.values())
            if open_now >= settings.requests_per_address:
                text = f"{open_now} sessions of this address are open (mcp.requests_per_address)"
                raise Refused(429, text, {"Retry-After": "10"})

    def _forget_ended_sessions(self) -> None:
        """Remove sessions that the SDK has ended because they were idle."""
        over = time.monotonic() - self.settings.session_idle_seconds
        self._sessions = {
            id: each for id, each in self._sessions.items() if each.under_way or each.used_at > over
        }

    def _note_session(self, request: HttpRequest, answer: HttpResponse, caller: _Caller) -> None:
        known = request.headers.get("mcp-session-id", "")
        if request.method == "DELETE" and answer.status < 400:
            self._sessions.pop(known, None)
        opened = answer.headers.get("mcp-session-id", "")
        # The SDK does not report which sessions it has ended.
        if opened and not known and answer.status < 400:
            self._forget_ended_sessions()
            program = _program_of(request)
            self._sessions[opened] = _Session(network_of(caller.info.address), time.monotonic(), program)

    def _left(self, caller: _Caller, visitor: Visitor, session: _Session | None) -> None:
        self._callers.discard(caller)
        visitor.release()
        if session is not None:
            session.under_way -= 1
            session.used_at = time.monotonic()

    # -- callbacks of the SDK's server -----------------------------------------------------------------------

    @asynccontextmanager
    async def agent(
        self, context: ServerRequestContext[Any, Any], allow: Allow | None = None, *, lasts: bool = False
    ) -> AsyncIterator[Agent]:
        """Return the sender of a request, while it is served or, if it `lasts`, for its subscription."""
        caller = _caller_of(context)
        if lasts:
            # A caller of its own, because a subscription outlasts the request that began it.
            caller = _Caller(caller.info, caller.role, is_stream=True)
        self._check_requests(caller, lasts=lasts)
        name = f"mcp:{_name_of(context)}"
        client = self.access.client(self.shared, caller.role, caller.info.address, name)
        gate, leave = self.access.gate, None
        if gate is not None and allow is not None:
            leave = partial(self._ask_for_leave, gate, client, caller, allow)
        notices: list[str] = []
        ended: list[str] = []

        def end(reason: str) -> None:
            ended.append(reason)
            scope.cancel()

        robot = ClientRobot(self.shared.graph, client, NODE, leave, end)
        client.tell_notices(partial(note_once, notices))
        caller.clients.add(client)
        if lasts:
            self._callers.add(caller)
        with anyio.CancelScope() as scope:
            caller.at_end.append(scope.cancel)
            try:
                yield Agent(
                    owner=caller.owner,
                    robot=robot,
                    settings=self.settings,
                    acts=_acts(caller.role),
                    goals=self._goals,
                    in_thread=partial(self._in_thread, client),
                    charge=partial(client.work.add, kind="pages"),
                    sees=client.may_subscribe,
                    how_to_act=_HOW_TO_ACT,
                    advertise=robot.advertise,
                    lease_seconds=robot.lease_seconds,
                    pass_gate=robot.pass_gate,
                    recordings=self._recordings,
                    may_stop=gate is not None and gate.may_stop(caller.role.name),
                    role=caller.role.name,
                    hidden=client.hidden,
                    notices=notices,
                )
            finally:
                caller.at_end.remove(scope.cancel)
                caller.clients.discard(client)
                if lasts:
                    self._callers.discard(caller)
                robot.close()
        if scope.cancelled_caught:
            raise ToolError(ended[0] if ended else "the request was abandoned: its client has gone")

    def _check_requests(self, caller: _Caller, *, lasts: bool) -> None:
        """Raise ToolError if the limit of requests, or of subscriptions if it `lasts`, is reached."""
        alike = [each for each in self._callers if each.is_stream is lasts]
        running = sum(len(each.clients) for each in alike)
        if running >= self.settings.requests and not caller.has_pressed_stop:
            raise ToolError(f"{running} agents are being served now (mcp.requests): try again in a moment")
        own = sum(len(each.clients) for each in alike if each.owner == caller.owner)
        if lasts and own >= self.settings.requests_per_address:
            raise ToolError(f"you have {own} subscriptions (mcp.requests_per_address): end one of them")

    async def _ask_for_leave(
        self, gate: Gate, client: ClientGraph, caller: _Caller, allow: Allow, seconds: float
    ) -> bool:
        """Ask the agent's user for pending approvals, if the role may answer them."""
        given = False
        while (asked := _asked_by(gate, client)) is not None:
            settings = asked.rule.settings.approval
            if settings is None or glob_pattern(settings.roles).fullmatch(caller.role.name) is None:
                return given
            try:
                # The approval may expire or be answered elsewhere meanwhile, so it is looked up again.
                await allow(caller.owner, f"{asked.act} {asked.name}: {asked.content} ({asked.rule.key})")
            except ToolError:
                if _asked_by(gate, client) is asked:
                    gate.approvals.answer(asked.id, approve=False, by=None)
                raise
            if _asked_by(gate, client) is asked:
                lasting = min(seconds + _STOP_SECONDS, settings.remember_seconds) if seconds else 0.0
                gate.approvals.answer(asked.id, approve=True, by=None, seconds=lasting)
                given = True
        return given

    async def _in_thread(self, client: ClientGraph, work: Callable[[], Answer]) -> Answer:
        def timed() -> tuple[Answer, float]:
            began = time.thread_time()
            return work(), time.thread_time() - began

        # Processor time is charged, not the wait for a free thread.
        answer, seconds = await anyio.to_thread.run_sync(timed, limiter=self._threads)
        client.work.add(seconds, "pictures")
        return answer

    def note(self, context: ServerRequestContext[Any, Any], text: str, *, acts: bool) -> None:
        """Write an action of an agent into the audit log."""
        level = logging.INFO if acts else logging.DEBUG
        if not (is_written(level) and self._log_rate.admit(time.monotonic())):
            return
        caller = _caller_of(context)
        said = f"the agent {_name_of(context)} ({caller.role.name}, {caller.info.address}): {text}"
        line = one_line(said) + self._log_rate.note()
        self.access.audit.write(level, "%s", line, client=f"{self.name}:{_name_of(context)}")

    def count(self, tool: str, outcome: str) -> None:
        """Count a call of a tool."""
        key = (tool, outcome)
        self._tool_calls[key] = self._tool_calls.get(key, 0) + 1

    # -- pages of the SDK's application ----------------------------------------------------------------------

    def _section(self, request: HttpRequest, reader: GraphView) -> str:
        url = url_of(request, "http") + PATH
        return (
            f"<h2>Agents</h2><p>Model Context Protocol, streamable HTTP: <code>{html.escape(url)}</code>,"
            f" {len(TOOLS)} tools, as role <code>{html.escape(self.settings.default_role)}</code> without a"
            " token."
        )

    def _metrics(self) -> Iterator[MetricFamily]:
        yield MetricFamily(
            "rwt_mcp_tool_calls_total",
            "counter",
            "Calls of tools by agents.",
            [({"tool": tool, "outcome": how}, count) for (tool, how), count in self._tool_calls.items()],
        )
        yield MetricFamily(
            "rwt_mcp_requests", "gauge", "Requests of agents under way.", [({}, len(self._callers))]
        )
        self._forget_ended_sessions()
        yield MetricFamily("rwt_mcp_sessions", "gauge", "Open sessions.", [({}, len(self._sessions))])
        yield MetricFamily(
            "rwt_mcp_refused_total", "counter", "Requests that were refused.", [({}, self._refused)]
        )


def _caller_of(context: ServerRequestContext[Any, Any]) -> _Caller:
    assert context.request is not None  # Every request here is an HTTP request.
    caller: _Caller = context.request.scope[_CALLER]
    return caller


def _name_of(context: ServerRequestContext[Any, Any]) -> str:
    """Return the name that an agent's program reports, shortened; it is not trusted."""
    params = context.session.client_params
    return _shortened("" if params is None else params.client_info.name)


def _shortened(program: str) -> str:
    return one_line(program[:60]) or "unnamed"


def _program_of(request: HttpRequest) -> str:
    """Return the name that an agent's program reports in a request which opens a session."""
    try:
        return msgspec.json.decode(request.body, type=_Initialize).params.program.name
    except (msgspec.DecodeError, UnicodeDecodeError):  # The SDK accepts more texts than msgspec.
        return ""


def _asked_by(gate: Gate, client: ClientGraph) -> Approval | None:
    return next((each for each in gate.approvals.pending if each.client.name == client.gate_name), None)


def _acts(role: Role) -> frozenset[Act]:
    """Return the actions that a role allows, except rosapi's services, which are open to all."""
    acts: tuple[Act, ...] = ("publish", "call", "goals", "set_param")
    return frozenset(act for act in acts if any(not glob.startswith("/rosapi/") for glob in role.globs[act]))


def _opens_session(request: HttpRequest) -> bool:
    """Return True if a request would open a session of an older protocol version."""
    spoken = request.headers.get("mcp-protocol-version")
    older = spoken is None or spoken in HANDSHAKE_PROTOCOL_VERSIONS
    return request.method == "POST" and older and "mcp-session-id" not in request.headers


class _Program(msgspec.Struct):
    """Program of an agent, as it describes itself."""

    name: str = ""


class _InitializeParams(msgspec.Struct):
    program: _Program = msgspec.field(default_factory=_Program, name="clientInfo")


class _Initialize(msgspec.Struct):
    """Request that opens a session."""

    params: _InitializeParams


class _Meta(msgspec.Struct):
    program: _Program = msgspec.field(default_factory=_Program, name=CLIENT_INFO_META_KEY)


class _ToolParams(msgspec.Struct):
    name: str
    arguments: dict[str, object] = {}
    meta: _Meta | None = msgspec.field(default=None, name="_meta")


class _ToolCall(msgspec.Struct):
    """Request that calls a tool."""

    method: str
    params: _ToolParams


def _refusal(refused: Refused) -> HttpResponse:
    body = {"jsonrpc": "2.0", "id": None, "error": {"code": -32600, "message": refused.reason}}
    return HttpResponse(json.dumps(body).encode(), refused.status, "application/json", refused.headers)
