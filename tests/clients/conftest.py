"""Real servers and real, unpatched client programs, each in a process of its own.

A program is started once for each distribution and stays: a test writes the name of a scenario and reads the
line that says what the client observed. What the library complained about on the way fails the test, unless
the test asks for the complaints.
"""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import pytest

HERE = Path(__file__).parent
NODE = HERE / "node"

PROGRAMS = {
    "roslib2": ["node", str(NODE / "roslib2.mjs")],
    "roslib1": ["node", str(NODE / "roslib1.cjs")],
    "roslibpy": [sys.executable, str(HERE / "roslibpy_program.py")],
}

#: What speaks another protocol than rosbridge.
OTHER_PROGRAMS = {"foxglove": ["node", str(NODE / "foxglove.mjs")]}

#: Seconds; a scenario gives up earlier by itself and says why.
_LINE_LIMIT = 25.0

#: What a client observed: ROS messages and answers, whose shape the tests know.
Observed = Any


class Answer(NamedTuple):
    """The line that a program printed for one scenario."""

    observed: Observed
    complaints: list[str]


class _Process:
    """A child process whose standard output is read by the line."""

    def __init__(self, command: list[str], log: IO[bytes]) -> None:
        self.popen = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True, encoding="utf-8"
        )
        self._name = " ".join(Path(part).name for part in command)
        self._log = Path(log.name)
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def write(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(f"{line}\n")
        self.popen.stdin.flush()

    def line(self) -> str:
        """The next line, or a failure with what the process wrote to its log."""
        try:
            line = self._lines.get(timeout=_LINE_LIMIT)
        except queue.Empty:
            pytest.fail(f"{self._name} printed nothing for {_LINE_LIMIT:g} s:\n{self.log()}")
        if line is None:
            pytest.fail(f"{self._name} ended with {self.popen.wait()}:\n{self.log()}")
        return line

    def log(self) -> str:
        return self._log.read_text(errors="replace")[-4000:]

    def end(self, signal_: signal.Signals | None) -> int:
        """Send `signal_`, or close standard input, and return the exit status."""
        if signal_ is not None:
            self.popen.send_signal(signal_)
        assert self.popen.stdin is not None
        self.popen.stdin.close()
        try:
            return self.popen.wait(timeout=60)
        finally:
            self.popen.kill()
            self.popen.wait()
            self._reader.join()
            assert self.popen.stdout is not None
            self.popen.stdout.close()


class Server:
    """`rwt serve --demo` on a free port."""

    def __init__(self, distro: str, log: IO[bytes], url: str = "ws://127.0.0.1:0") -> None:
        command = [sys.executable, "-m", "rwt.cli", "serve", "--demo", "--distro", distro, url]
        self._process = _Process(command, log)
        try:
            announced = self._process.line()
            assert announced.startswith("listening on ws://127.0.0.1:"), announced
        except BaseException:
            self._process.end(signal.SIGKILL)
            raise
        self.url = announced.removeprefix("listening on ")

    def end(self) -> int:
        """Stop it as a service manager does, and return its exit status."""
        return self._process.end(signal.SIGTERM)


class Program:
    """One client library, connected to one server."""

    def __init__(self, name: str, url: str, log: IO[bytes]) -> None:
        self.name = name
        self.url = url
        self._scenario = ""
        self._process = _Process([*{**PROGRAMS, **OTHER_PROGRAMS}[name], url], log)

    def start(self, scenario: str) -> None:
        self._scenario = scenario
        self._process.write(scenario)

    def printed(self) -> str:
        """A line that a scenario prints before its end."""
        return self._process.line()

    def finish(self) -> Answer:
        """Return the observations of the scenario that was started last."""
        report = json.loads(self._process.line())
        assert report["scenario"] == self._scenario
        assert "failed" not in report, f"{self.name}: {report['failed']}\n{report['complaints']}"
        return Answer(report["observed"], report["complaints"])

    def answer(self, scenario: str) -> Answer:
        self.start(scenario)
        return self.finish()

    def observe(self, scenario: str) -> Observed:
        """Return the observations of the scenario; fails if the library logged an error."""
        observed, complaints = self.answer(scenario)
        assert complaints == []
        return observed

    def end(self) -> int:
        """Let it run to its end, and return its exit status."""
        return self._process.end(None)

    def kill(self) -> None:
        """End it as a crash does, in the middle of whatever it does."""
        self._process.popen.kill()
        self._process.popen.wait()


@pytest.fixture(scope="session")
def client_packages() -> None:
    """The npm packages are there; `make test-all` installs them."""
    if not (NODE / "node_modules" / "roslib1").is_dir():
        pytest.fail(
            "the npm clients are not installed: run `npm ci --prefix tests/clients/node`", pytrace=False
        )


StartServer = Callable[..., AbstractContextManager[Server]]
StartProgram = Callable[..., AbstractContextManager[Program]]


@pytest.fixture(scope="session")
def start_server(tmp_path_factory: pytest.TempPathFactory) -> StartServer:
    """Start a server of its own for one test: `with start_server("jazzy") as server`."""
    logs = tmp_path_factory.mktemp("servers")

    @contextmanager
    def start(distro: str, url: str = "ws://127.0.0.1:0") -> Iterator[Server]:
        with (logs / f"{len(list(logs.iterdir()))}.log").open("wb") as log:
            server = Server(distro, log, url)
            try:
                yield server
            finally:
                assert server.end() == 0

    return start


@pytest.fixture(scope="session")
def start_program(tmp_path_factory: pytest.TempPathFactory, client_packages: None) -> StartProgram:
    """Start a program of its own for one test: `with start_program("roslib2", url) as program`."""
    logs = tmp_path_factory.mktemp("programs")

    @contextmanager
    def start(name: str, url: str) -> Iterator[Program]:
        with (logs / f"{len(list(logs.iterdir()))}.log").open("wb") as log:
            program = Program(name, url, log)
            try:
                yield program
            finally:
                # A test may have killed it; no other end than that and the regular one is good.
                assert program.end() in (0, -signal.SIGKILL)

    return start


@pytest.fixture(scope="session")
def server_of(start_server: StartServer) -> Iterator[Callable[[str], Server]]:
    """The one server of each distribution, started when the first test asks for it."""
    servers: dict[str, Server] = {}
    failed: dict[str, str] = {}
    with ExitStack() as running:

        def of(distro: str) -> Server:
            if distro in failed:
                pytest.fail(f"the {distro} server did not come up before:\n{failed[distro]}", pytrace=False)
            if distro not in servers:
                try:
                    servers[distro] = running.enter_context(start_server(distro))
                except BaseException as error:
                    failed[distro] = str(error)
                    raise
            return servers[distro]

        yield of


@pytest.fixture(scope="session")
def program_of(
    start_program: StartProgram, server_of: Callable[[str], Server]
) -> Iterator[Callable[[str, str], Program]]:
    """The one program of each library and distribution."""
    programs: dict[tuple[str, str], Program] = {}
    with ExitStack() as running:

        def of(name: str, distro: str) -> Program:
            if (name, distro) not in programs:
                url = server_of(distro).url
                programs[name, distro] = running.enter_context(start_program(name, url))
            return programs[name, distro]

        yield of


@pytest.fixture(params=["jazzy", "noetic"])
def distro(request: pytest.FixtureRequest) -> str:
    """Each: the names of types and the fields of times that a library reads and writes differ."""
    return str(request.param)


@pytest.fixture(params=list(PROGRAMS))
def client(request: pytest.FixtureRequest, distro: str, program_of: Callable[[str, str], Program]) -> Program:
    """A client program, once for each library and distribution."""
    return program_of(request.param, distro)


@pytest.fixture(params=["roslib2", "roslib1"])
def roslib(request: pytest.FixtureRequest, distro: str, program_of: Callable[[str, str], Program]) -> Program:
    """The JavaScript clients, for what roslibpy has no call for."""
    return program_of(request.param, distro)


@pytest.fixture
def roslib2(distro: str, program_of: Callable[[str, str], Program]) -> Program:
    return program_of("roslib2", distro)


@pytest.fixture
def roslib1(distro: str, program_of: Callable[[str, str], Program]) -> Program:
    return program_of("roslib1", distro)


@pytest.fixture
def roslibpy(distro: str, program_of: Callable[[str, str], Program]) -> Program:
    return program_of("roslibpy", distro)
