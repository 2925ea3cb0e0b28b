"""Programs of the documentation, each in a process of its own."""

from __future__ import annotations

import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.docs.blocks import ROOT

#: Seconds that one example may take before its test fails.
LIMIT = 90.0


def commands_folder(folder: Path) -> Path:
    """A folder with the commands that the documentation names, of the Python that runs the tests."""
    folder.mkdir()
    for name, arguments in {
        "rwt": "-m rwt.cli",
        "python": "",
        "pytest": "-m pytest",
        "rosbridge-conformance": "-m rosbridge_conformance",
    }.items():
        command = folder / name
        command.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments} "$@"\n')
        command.chmod(0o755)
    return folder


class Running:
    """A process whose standard output is read by the line; ended with everything it started when left."""

    def __init__(
        self,
        command: list[str],
        folder: Path,
        commands: Path,
        limit: float = LIMIT,
        packages: Sequence[Path] = (ROOT / "src", ROOT / "conformance"),
    ) -> None:
        self._errors = folder / "stderr.log"
        environment = {
            **os.environ,
            "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join(map(str, packages)),
            "PYTHONUNBUFFERED": "1",
            # An example that is a test module needs none, and each costs time.
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        }
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,
            )
        self._deadline = time.monotonic() + limit
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._seen: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._reader.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _left(self) -> float:
        return max(0.01, self._deadline - time.monotonic())

    def interrupt(self) -> None:
        """Interrupt the program and its children, as Ctrl-C in a terminal does."""
        os.killpg(self._process.pid, signal.SIGINT)

    def report(self) -> str:
        """Return the standard output and standard error so far."""
        return "\n".join([*self._seen, self._errors.read_text(errors="replace")])[-4000:]

    def wait_for(self, text: str) -> None:
        """Read on until a line contains `text`."""
        while True:
            try:
                line = self._lines.get(timeout=self._left())
            except queue.Empty:
                raise AssertionError(f"{text!r} was not printed in time:\n{self.report()}") from None
            if line is None:
                raise AssertionError(f"it ended without printing {text!r}:\n{self.report()}")
            self._seen.append(line)
            if text in line:
                return

    def wait_for_port(self, port: int) -> None:
        """Wait until it listens."""
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=self._left()).close()
                return
            except ConnectionRefusedError:
                pass
            try:
                self._process.wait(timeout=0.05)
            except subprocess.TimeoutExpired:
                assert time.monotonic() < self._deadline, f"it does not listen:\n{self.report()}"
                continue
            raise AssertionError(f"it ended instead of listening:\n{self.report()}")

    def expect_no_complaint(self) -> None:
        """Check that standard error reports no failure."""
        errors = self._errors.read_text(errors="replace")
        assert "Traceback" not in errors and "ERROR" not in errors, self.report()

    def expect_end(self, expected: int = 0) -> None:
        """Wait for its end, which must be a good one: with this exit code and without a failure."""
        try:
            code = self._process.wait(timeout=self._left())
        except subprocess.TimeoutExpired:
            raise AssertionError(f"it does not end:\n{self.report()}") from None
        assert code == expected, f"exit code {code}:\n{self.report()}"
        self.expect_no_complaint()
