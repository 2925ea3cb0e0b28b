"""Processes of a launch: start, output and end.

At the end of the launch a process gets SIGINT; after `sigterm_timeout` seconds SIGTERM, and after
`sigkill_timeout` more SIGKILL. Ctrl-C at a terminal reaches it directly, and is not sent again.
"""

from __future__ import annotations

import asyncio
import os
import shlex
import signal
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from rwt_protocol.states import StateEnum
from rwt_rclpy.launch.entities import (
    Action,
    LaunchContext,
    LaunchDescriptionEntity,
    LaunchError,
    SomeSubstitutionsType,
    SomeText,
    text,
    truth,
)
from rwt_rclpy.launch.event_handlers import OnEvent, OnMatch, OnProcessExit, OnShutdown
from rwt_rclpy.launch.events import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
    ProcessStderr,
    ProcessStdout,
    Shutdown,
    ShutdownProcess,
    SignalProcess,
)
from rwt_rclpy.launch.logging import get_logger, show
from rwt_rclpy.launch.substitutions import LaunchConfiguration

#: Time for which the output of an ended process is read, if its children keep it open, in seconds.
_READ_ON: Final = 1.0
#: Maximum size of a line of output; longer ones are split.
_LONGEST_LINE: Final = 1 << 20

_SIGTERM_TIMEOUT: Final = LaunchConfiguration("sigterm_timeout", default=5)
_SIGKILL_TIMEOUT: Final = LaunchConfiguration("sigkill_timeout", default=5)


class _ProcessState(StateEnum):
    NEW = "STARTING"
    STARTING = "RUNNING", "ENDED"
    RUNNING = "WAITING", "ENDED"
    WAITING = "STARTING", "ENDED"
    ENDED = ()


class ExecuteProcess(Action):
    """Action that starts a process.

    Life cycle::

        NEW ── execute() ──> STARTING ── started ──> RUNNING ── ended ──> ENDED
                              ^    └─ cannot be started ──│───────────────^ ^
                              │                           │ respawn         │
                              └── delay is over ────── WAITING ── shutdown ─┘

    A shutdown may come in every state: ``_is_to_end`` is set then, and a running process gets its signals in
    the task ``_ending``.

    Args:
        cmd: program and arguments, each a text, a substitution or a list of them, which is joined.
        name: name of the process, by default the program; a number is appended.
        cwd: working directory.
        env: whole environment; by default that of the launch.
        additional_env: variables that are added.
        prefix: command in front of it.
        shell: True to run it in a shell.
        output: destination of its output as in ROS; here all output is shown.
        output_format: format of lines.
        cached_output: True to keep the output for :meth:`get_stdout` and :meth:`get_stderr`.
        emulate_tty: accepted; Python processes run unbuffered in any case.
        log_cmd: True to log the command.
        on_exit: actions or function to execute at its end.
        respawn, respawn_delay, respawn_max_retries: restart after its end, delay in
            seconds, and maximum number of restarts; unlimited by default.
        sigterm_timeout, sigkill_timeout: seconds until the next stronger signal.

    Attributes:
        process: process; None before the start.
        name: name with number.
    """

    def __init__(
        self,
        *,
        cmd: Iterable[SomeText],
        name: SomeSubstitutionsType | None = None,
        cwd: SomeSubstitutionsType | None = None,
        env: Mapping[Any, SomeText] | None = None,
        additional_env: Mapping[Any, SomeText] | None = None,
        prefix: SomeSubstitutionsType | None = None,
        shell: bool = False,
        output: SomeSubstitutionsType | Mapping[str, str] = "log",
        output_format: str = "[{this.name}] {line}",
        cached_output: bool = False,
        emulate_tty: bool | SomeText = False,
        log_cmd: bool = False,
        on_exit: OnEvent | None = None,
        respawn: bool | SomeText = False,
        respawn_delay: float | None = None,
        respawn_max_retries: int = -1,
        sigterm_timeout: SomeText = _SIGTERM_TIMEOUT,
        sigkill_timeout: SomeText = _SIGKILL_TIMEOUT,
        **action: Any,
    ) -> None:
        super().__init__(**action)
        self._cmd = list(cmd)
        self._name, self._cwd, self._env, self._additional_env = name, cwd, env, additional_env
        self._prefix = LaunchConfiguration("launch-prefix", default="") if prefix is None else prefix
        self._shell, self._output_format, self._log_cmd = shell, output_format, log_cmd
        self._emulate_tty = emulate_tty
        self._on_exit = on_exit
        self._respawn, self._respawn_delay, self._respawn_left = respawn, respawn_delay, respawn_max_retries
        self._timeouts = ((sigterm_timeout, signal.SIGTERM), (sigkill_timeout, signal.SIGKILL))
        self._cached: dict[bool, list[str]] | None = {True: [], False: []} if cached_output else None
        self.name = ""
        self.process: asyncio.subprocess.Process | None = None
        self._described: dict[str, Any] = {}
        self._task: asyncio.Task[None] | None = None
        self._ending: asyncio.Task[None] | None = None
        self._is_to_end = asyncio.Event()
        self._state = _ProcessState.NEW

    @property
    def cmd(self) -> list[SomeText]:
        """Program and arguments, as given."""
        return self._cmd

    @property
    def pid(self) -> int | None:
        """Process id; None before the start."""
        return None if self.process is None else self.process.pid

    @property
    def return_code(self) -> int | None:
        """Exit code; None while it runs."""
        return None if self.process is None else self.process.returncode

    @property
    def executable(self) -> str:
        """Name of the program."""
        return os.path.basename(self._described["cmd"][0]) if self._described else ""

    @property
    def process_details(self) -> dict[str, Any] | None:
        """Details of the process; None before the start."""
        return self._described or None

    def get_asyncio_future(self) -> asyncio.Future[None] | None:
        """Return a future that is done at the end of the process and its restarts."""
        return self._task

    def get_stdout(self) -> str:
        """Return the standard output so far. Raises LaunchError without `cached_output`."""
        return "".join(self._kept()[True])

    def get_stderr(self) -> str:
        """Return the standard error so far. Raises LaunchError without `cached_output`."""
        return "".join(self._kept()[False])

    def _kept(self) -> dict[bool, list[str]]:
        if self._cached is None:
            raise LaunchError("the output of a process is kept with cached_output=True only")
        return self._cached

    def get_sub_entities(self) -> list[LaunchDescriptionEntity]:
        """Return the entities to visit at the end of the process, as far as they are known."""
        return [] if callable(self._on_exit) else OnProcessExit(on_exit=self._on_exit).entities

    def execute(self, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
        """Start the process. Raises LaunchError if it was started before."""
        if self._state is not _ProcessState.NEW:
            raise LaunchError(f"process {self.name} is in the launch description twice")
        if context.is_shutdown:
            return None
        self._describe(context)
        for handler in (
            OnShutdown(on_shutdown=self._on_shutdown),
            OnProcessExit(target_action=self, on_exit=self._on_exit),
            self._on_request(ShutdownProcess, lambda event, _: self._end(context, sends_sigint=True)),
            self._on_request(SignalProcess, lambda event, _: self._signal(event.signal)),
        ):
            context.register_event_handler(handler)
        self._state = self._state.become(_ProcessState.STARTING)
        self._task = context.asyncio_loop.create_task(self._run(context))
        return None

    def _on_request(
        self, kind: type[ShutdownProcess | SignalProcess], call: Callable[[Any, LaunchContext], None]
    ) -> OnMatch:
        """Handler of events that select this process."""
        return OnMatch(lambda event: isinstance(event, kind) and event.process_matcher(self), call)

    def _describe(self, context: LaunchContext) -> None:
        """Evaluate command, name, working directory and environment."""
        command = [text(context, each) for each in self._cmd]
        if not command or not command[0]:
            raise LaunchError("a process has no command")
        prefix = shlex.split(text(context, self._prefix))
        program = os.path.basename(command[0].split()[0])
        called = program if self._name is None else os.path.basename(text(context, self._name))
        context.process_count += 1
        self.name = f"{called}-{context.process_count}"
        chosen = context.environment if self._env is None else self._env
        env = {
            text(context, key): text(context, value)
            for given in (chosen, self._additional_env or {})
            for key, value in given.items()
        }
        if truth(context, context.launch_configurations.get("emulate_tty", self._emulate_tty)):
            env.setdefault("PYTHONUNBUFFERED", "1")
        self._respawns = truth(context, self._respawn)
        self._seconds = [(float(text(context, seconds)), number) for seconds, number in self._timeouts]
        self._described = {
            "action": self,
            "name": self.name,
            "cmd": [*prefix, *command],
            "cwd": None if self._cwd is None else text(context, self._cwd),
            "env": env,
        }

    async def _run(self, context: LaunchContext) -> None:
        log = get_logger(self.name)
        while True:
            code = await self._once(context)
            if code == 0:
                log.info(f"process has finished cleanly [pid {self.pid}]")
            else:
                log.error(
                    f"process has died [pid {self.pid}, exit code {code}, cmd"
                    f" '{' '.join(self._described['cmd'])}']."
                )
            context.emit_event_sync(ProcessExited(returncode=code, **self._described, pid=self.pid))
            if not self._respawns or self._is_to_end.is_set() or not self._respawn_left:
                break
            self._respawn_left -= 1
            self._state = self._state.become(_ProcessState.WAITING)
            try:
                await asyncio.wait_for(self._is_to_end.wait(), self._respawn_delay or 0.0)
                break
            except TimeoutError:
                self._state = self._state.become(_ProcessState.STARTING)
        self._state = self._state.become(_ProcessState.ENDED)

    async def _once(self, context: LaunchContext) -> int:
        """Start the process, and read its output until its end; return the exit code."""
        command, log = self._described["cmd"], get_logger(self.name)
        if self._log_cmd:
            log.info(f"process details: cmd='{' '.join(command)}', cwd='{self._described['cwd']}'")
        pipes: dict[str, Any] = {
            "stdin": asyncio.subprocess.DEVNULL,
            "stdout": asyncio.subprocess.PIPE,
            "stderr": asyncio.subprocess.PIPE,
            "cwd": self._described["cwd"],
            "env": self._described["env"],
            "limit": _LONGEST_LINE,
        }
        try:
            self.process = process = await (
                asyncio.create_subprocess_shell(" ".join(command), **pipes)
                if self._shell
                else asyncio.create_subprocess_exec(*command, **pipes)
            )
        except OSError as error:
            self._state = self._state.become(_ProcessState.ENDED)
            raise LaunchError(f"{self.name}: {command[0]} cannot be started: {error}") from error
        self._state = self._state.become(_ProcessState.RUNNING)
        log.info(f"process started with pid [{process.pid}]")
        context.emit_event_sync(ProcessStarted(**self._described, pid=process.pid))
        readers = [
            asyncio.create_task(self._read(context, process.stdout, ProcessStdout)),
            asyncio.create_task(self._read(context, process.stderr, ProcessStderr)),
        ]
        if self._is_to_end.is_set():
            self._ending = asyncio.create_task(self._escalate(sends_sigint=True))
        code = await process.wait()
        _, late = await asyncio.wait(readers, timeout=_READ_ON)
        for reader in late:
            reader.cancel()
        return code

    async def _read(
        self, context: LaunchContext, stream: asyncio.StreamReader | None, event: type[ProcessIO]
    ) -> None:
        assert stream is not None  # It was asked for.
        while True:
            try:
                data = await stream.readuntil(b"\n")
            except asyncio.IncompleteReadError as error:
                data = error.partial
            except asyncio.LimitOverrunError as error:
                data = await stream.read(error.consumed)
            if not data:
                return
            said = data.decode(errors="replace")
            show(self._output_format.format(line=said.rstrip("\r\n"), this=self))
            if self._cached is not None:
                self._cached[event.from_stdout].append(said)
            told = event(text=data, **self._described, pid=self.pid)
            if context.would_handle_event(told):
                context.emit_event_sync(told)

    def _on_shutdown(self, event: Shutdown, context: LaunchContext) -> None:
        self._end(context, sends_sigint=not event.due_to_sigint or context.noninteractive)

    def _end(self, context: LaunchContext, *, sends_sigint: bool) -> None:
        """Begin to end the process, once; a starting one is ended once it runs."""
        if self._is_to_end.is_set():
            return
        self._is_to_end.set()
        if self._state is _ProcessState.RUNNING:
            self._ending = context.asyncio_loop.create_task(self._escalate(sends_sigint=sends_sigint))

    async def _escalate(self, *, sends_sigint: bool) -> None:
        assert self.process is not None and self._task is not None  # It runs.
        if sends_sigint:
            self._signal(signal.SIGINT)
        sent, ended = signal.SIGINT, asyncio.ensure_future(self.process.wait())
        for seconds, number in self._seconds:
            await asyncio.wait({ended}, timeout=seconds)
            if ended.done():
                return
            get_logger(self.name).error(
                f"process[{self.name}] failed to terminate '{seconds:g}' seconds after receiving"
                f" '{sent.name}', escalating to '{number.name}'"
            )
            self._signal(number)
            sent = number
        await ended

    def _signal(self, number: signal.Signals) -> None:
        if self.process is None or self.process.returncode is not None:
            return
        get_logger(self.name).info(f"sending signal '{number.name}' to process[{self.name}]")
        try:
            self.process.send_signal(number)
        except ProcessLookupError:
            get_logger(self.name).debug("it has ended already")


ExecuteLocal = ExecuteProcess
