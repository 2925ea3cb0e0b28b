"""Clients of a session, on sockets alone: they know nothing of the server's code."""

from __future__ import annotations

import http.client
import json
import re
import socket
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.processes import running
from tests.traces.transcript import Transcript, frame_text

SECONDS: Final = 60.0
"""Time within which a frame comes, also on a busy machine."""

_VARIABLES: Final = {"PYTHONHASHSEED": "0"}


_ALWAYS: Final = {
    "Date": r"\w{3}, \d\d \w{3} \d{4} \d\d:\d\d:\d\d GMT",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
"""Headers of every answer, with the patterns of their values."""


def _compact(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def _octets(data: str | bytes) -> bytes:
    return data.encode() if isinstance(data, str) else data


@contextmanager
def serving(*arguments: str, folder: Path | None = None) -> Iterator[str]:
    """Run `rwt serve`, and yield its URL. The dashboard is off: not every checkout has it built."""
    with running(
        "serve",
        "--set",
        "web.enabled=false",
        *arguments,
        "ws://127.0.0.1:0",
        stderr=subprocess.DEVNULL,
        folder=folder,
        environment=_VARIABLES,
    ) as (_, url):
        yield url


class Wire:
    """A WebSocket client whose frames are noted.

    Args:
        transcript: where they are noted.
        name: name of the client there.
        url: where it connects.
        subprotocols: those that it offers.
        headers: further headers of its request.
        encode: how it writes what is neither a string nor bytes.
    """

    def __init__(
        self,
        transcript: Transcript,
        name: str,
        url: str,
        subprotocols: Iterable[str] = (),
        headers: Mapping[str, str] | None = None,
        encode: Callable[[Any], str | bytes] = _compact,
    ) -> None:
        self._transcript = transcript
        self._name = name
        self._encode = encode
        self._marks = 0
        offered = [Subprotocol(each) for each in subprotocols]
        self._stack = ExitStack()
        self._wire: ClientConnection = self._stack.enter_context(
            connect(
                url,
                subprotocols=offered or None,
                additional_headers=dict(headers or {}),
                compression=None,
                proxy=None,
                max_size=None,
                ping_interval=None,
                open_timeout=SECONDS,
            )
        )

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def head(self) -> str:
        """Head of the server's answer to the handshake."""
        response = self._wire.response
        assert response is not None
        lines = [f"{name}: {value}" for name, value in response.headers.raw_items()]
        return "\n".join([f"{response.status_code} {response.reason_phrase}", *lines])

    def say(self, frame: object) -> None:
        """Send a frame: a string or bytes as they are, everything else encoded."""
        data = frame if isinstance(frame, (str, bytes)) else self._encode(frame)
        shown = frame_text(data)
        if len(shown) > 2000:
            shown = f"{shown[:200]}… {len(shown)} characters"
        self._transcript.add(f"{self._name}> {shown}")
        self._wire.send(data)

    def hear(self, count: int = 1) -> str | bytes:
        """Wait for so many frames, note them and return the last."""
        data: str | bytes = ""
        for _ in range(count):
            data = self._wire.recv(SECONDS)
            self._note(data)
        return data

    def hear_json(self) -> Any:
        """Wait for a frame, note it and return what it holds."""
        return json.loads(self.hear())

    def hear_fragments(self) -> None:
        """Note fragments up to the last of a message."""
        while (piece := self.hear_json())["num"] < piece["total"] - 1:
            pass

    def hear_until(self, part: str) -> str | bytes:
        """Note frames up to one with this text, and return it."""
        while True:
            data = self.hear()
            if isinstance(data, str) and part in data:
                return data

    def hear_only(self, part: str, last: str) -> None:
        """Note frames with one text, up to one with another."""
        while True:
            data = self._wire.recv(SECONDS)
            assert isinstance(data, str)
            if part in data:
                self._note(data)
            if last in data:
                return

    def settle(self) -> None:
        """Note all that comes before the answer to a call that is refused at once."""
        self._marks += 1
        mark = f"mark {self._marks}."
        self._wire.send(self._encode({"op": "call_service", "id": mark, "service": "/no_such_service"}))
        while mark.encode() not in _octets(data := self._wire.recv(SECONDS)):
            self._note(data)

    def ask(self, *frames: object) -> None:
        """Send frames, and note what answers each."""
        for frame in frames:
            self.say(frame)
            self.settle()

    def hear_close(self) -> None:
        """Note what comes until the server closes the connection, and how it does."""
        try:
            while True:
                self._note(self._wire.recv(SECONDS))
        except ConnectionClosed as closed:
            received = closed.rcvd
            how = "without a close frame" if received is None else f"{received.code} {received.reason}"
            self._transcript.add(f"{self._name}< closed: {how}")

    def redirect(self, transcript: Transcript) -> None:
        """Note what follows elsewhere."""
        self._transcript = transcript

    def close(self) -> None:
        """Disconnect, and note it."""
        self._stack.close()
        self._transcript.add(f"{self._name}> closed")

    def _note(self, data: str | bytes) -> None:
        self._transcript.add(f"{self._name}< {frame_text(data)}")


def _note_headers(transcript: Transcript, headers: Iterable[tuple[str, str]]) -> None:
    """Note the headers of an answer: of those that all answers should have, only the ones that it lacks."""
    lacking = dict(_ALWAYS)
    others = []
    for name, value in headers:
        if re.fullmatch(lacking.get(name, ""), value):
            del lacking[name]
        else:
            others.append(f"{name}: {value}")
    transcript.add_row([*others, *(f"without {name}" for name in lacking)])


def refused(transcript: Transcript, url: str, headers: Mapping[str, str] | None = None) -> None:
    """Connect where that is refused, and note the answer."""
    try:
        Wire(transcript, "refused", url, headers=headers)
    except InvalidStatus as error:
        response = error.response
        transcript.add(f"refused< {response.status_code} {response.reason_phrase}")
        _note_headers(transcript, response.headers.raw_items())
        transcript.add((response.body or b"").decode())
    else:
        raise AssertionError("the server let the client in")


class Http:
    """An HTTP client that notes requests and answers.

    Args:
        transcript: where they are noted.
        url: URL of the server's WebSocket.
    """

    def __init__(self, transcript: Transcript, url: str) -> None:
        self._transcript = transcript
        self._host = str(urlsplit(url).hostname)
        self._port = int(urlsplit(url).port or 0)

    def request(
        self,
        method: str,
        path: str,
        body: str | bytes | None = None,
        headers: Mapping[str, str] | None = None,
        *,
        events: int | None = None,
        show: bool = True,
    ) -> tuple[http.client.HTTPMessage, str]:
        """Send a request, and return the answer's headers and body.

        Args:
            method: method of HTTP.
            path: path and query.
            body: what is sent.
            headers: further headers.
            events: blank lines to wait for in a stream, which is closed after them.
            show: whether the body and its length are noted.
        """
        connection = http.client.HTTPConnection(self._host, self._port, timeout=SECONDS)
        try:
            asked = [f"{name}: {value}" for name, value in (headers or {}).items()]
            self._transcript.add_row([f"> {method} {path}", *asked])
            if body is not None:
                shown = body if isinstance(body, str) else f"hex {body.hex()}"
                self._transcript.add(f"> {shown[:2000]}")
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            self._transcript.add(f"< {answer.status} {answer.reason}")
            noted = [each for each in answer.getheaders() if show or each[0] != "Content-Length"]
            _note_headers(self._transcript, noted)
            text = self._body(answer, events)
            if show and text:
                self._transcript.add(text)
            return answer.headers, text
        finally:
            connection.close()

    @staticmethod
    def _body(answer: http.client.HTTPResponse, events: int | None) -> str:
        if events is None:
            data = answer.read()
        else:
            lines: list[bytes] = []
            while events > 0:
                line = answer.readline()
                assert line, lines
                lines.append(line)
                events -= line in (b"\n", b"\r\n")
            data = b"".join(lines)
        try:
            return data.decode()
        except UnicodeDecodeError:
            return f"hex {data.hex()}"


def raw_exchange(transcript: Transcript, url: str, data: bytes) -> None:
    """Send bytes to the server's port, and note all that comes back."""
    with socket.create_connection(
        (str(urlsplit(url).hostname), int(urlsplit(url).port or 0)), timeout=SECONDS
    ) as wire:
        wire.sendall(data)
        for line in data.decode().split("\r\n"):
            transcript.add(f"> {line}")
        received = b""
        while chunk := wire.recv(65536):
            received += chunk
    transcript.add(received.decode().replace("\r\n", "\n"))
