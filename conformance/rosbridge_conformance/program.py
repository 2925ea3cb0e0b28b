"""Program around a client library: a child process, controlled by lines of JSON."""

from __future__ import annotations

import asyncio
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from rosbridge_conformance.suite.values import Json

_LONGEST_LINE = 1 << 26
START_SECONDS = 20.0
END_SECONDS = 3.0


class ProgramError(Exception):
    """A program cannot be used; the text names it and the reason."""


class ProgramEnded(Exception):
    """The program has ended, or closed its standard output."""


class Driven(Protocol):
    """Client library controlled by commands, in a child process, or in this one for tests.

    Attributes:
        on_event: called with each event.
        on_noise: called with each unknown line.
    """

    on_event: Callable[[dict[str, Json]], None]
    on_noise: Callable[[str], None]

    async def tell(self, command: Mapping[str, Json]) -> dict[str, Json]:
        """Execute a command, and return the response. Raises ProgramEnded."""

    def kill(self) -> None:
        """Kill the program."""


class Program:
    """Running program around a client library.

    Attributes:
        library: name and version of the library, reported by the program.
        on_event: called with each event.
        on_noise: called with each line that is not a JSON object, and each line of standard error.
    """

    def __init__(self, command: Sequence[str], process: asyncio.subprocess.Process) -> None:
        self.library = ""
        self.on_event: Callable[[dict[str, Json]], None] = lambda event: None
        self.on_noise: Callable[[str], None] = lambda text: None
        self._name = shlex.join(command)
        self._process = process
        self._numbers = 0
        self._answers: dict[int, asyncio.Future[dict[str, Json]]] = {}
        self._hello: asyncio.Future[dict[str, Json]] = asyncio.get_running_loop().create_future()
        self._last_words: list[str] = []
        self._readers = (asyncio.create_task(self._read_output()), asyncio.create_task(self._read_errors()))

    @classmethod
    async def start(cls, command: Sequence[str]) -> Program:
        """Start a program and wait until it reports that it is ready.

        Raises:
            ProgramError: it cannot be started, or is not ready within 20 seconds.
        """
        try:
            process = await asyncio.create_subprocess_exec(
                *command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
                limit=_LONGEST_LINE,
            )
        except OSError as error:
            raise ProgramError(f"{shlex.join(command)}: cannot start: {error.strerror}") from error
        program = cls(command, process)
        try:
            async with asyncio.timeout(START_SECONDS):
                hello = await program._hello
        except (TimeoutError, ProgramEnded) as error:
            await program.end()
            said = "".join(f"\n  {line}" for line in program._last_words)
            raise ProgramError(f'{program._name}: said no {{"event": "ready"}} line{said}') from error
        except asyncio.CancelledError:
            await program.end()
            raise
        program.library = f"{hello.get('library', 'unnamed library')} {hello.get('version', '')}".strip()
        return program

    async def tell(self, command: Mapping[str, Json]) -> dict[str, Json]:
        """Send a command, and return the response.

        Raises:
            ProgramEnded: the program has ended.
        """
        if self._process.stdin is None or self._readers[0].done():
            raise ProgramEnded
        self._numbers += 1
        answer: asyncio.Future[dict[str, Json]] = asyncio.get_running_loop().create_future()
        self._answers[self._numbers] = answer
        line = json.dumps({"n": self._numbers, **command})
        try:
            self._process.stdin.write(f"{line}\n".encode())
            await self._process.stdin.drain()
        except OSError as error:
            raise ProgramEnded from error
        return await answer

    async def end(self) -> None:
        """Close standard input; kill the program if it does not end."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            async with asyncio.timeout(END_SECONDS):
                await self._process.wait()
        except TimeoutError:
            self.kill()
            await self._process.wait()
        await asyncio.gather(*self._readers, return_exceptions=True)

    def kill(self) -> None:
        """Kill the program."""
        if self._process.returncode is None:
            self._process.kill()

    async def _read_output(self) -> None:
        assert self._process.stdout is not None
        try:
            while line := await self._process.stdout.readline():
                self._take(line.decode("utf-8", "replace").strip())
        except ValueError:
            self.on_noise(f"a line of more than {_LONGEST_LINE} bytes")
        finally:
            for answer in (self._hello, *self._answers.values()):
                if not answer.done():
                    answer.set_exception(ProgramEnded())
                    answer.exception()  # Mark the exception as retrieved: the caller may not wait for it.

    async def _read_errors(self) -> None:
        assert self._process.stderr is not None
        while line := await self._process.stderr.readline():
            self._hear_noise(line.decode("utf-8", "replace").rstrip())

    def _hear_noise(self, text: str) -> None:
        self._last_words = [*self._last_words[-9:], text]
        self.on_noise(text)

    def _take(self, text: str) -> None:
        try:
            value: Json = json.loads(text)
        except ValueError:
            value = None
        if not isinstance(value, dict):
            self._hear_noise(text)
        elif value.get("event") == "ready":
            if not self._hello.done():
                self._hello.set_result(value)
        elif "event" in value:
            self.on_event(value)
        else:
            self._answer(value, text)

    def _answer(self, value: dict[str, Json], text: str) -> None:
        number = value.get("n")
        answer = self._answers.pop(number, None) if isinstance(number, int) else None
        if answer is None:
            self._hear_noise(text)
        elif not answer.done():
            answer.set_result(value)
