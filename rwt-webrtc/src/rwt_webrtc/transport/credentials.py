"""STUN and TURN servers of a new peer, with temporary credentials from a command or a URL.

Responses are JSON as in TURN's REST API (draft-uberti-behave-turn-rest): ``{"username": "…", "password": "…",
"ttl": 86400, "uris": ["turn:…"]}``; `uris` is optional if the settings name the servers.
"""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Final

import anyio
import anyio.to_thread

from rwt_transports.errors import Refused
from rwt_webrtc.transport.ice_servers import BadIceServer, IceServer, check_ice_url

ANSWER_BYTES: Final = 16 * 1024
SECONDS: Final = 5.0
"""Timeout of a command or URL in seconds."""
REUSED: Final = 0.5
"""Part of the lifetime of a credential in which further peers get it."""
MOST_SERVERS: Final = 8


class NoIceServers(Refused):
    """The STUN and TURN servers are not available."""

    def __init__(self, reason: str) -> None:
        super().__init__(503, reason)


@dataclass(frozen=True, slots=True)
class IceSource:
    """Source of the servers.

    Attributes:
        urls: URLs of servers: STUN, and TURN with the credential.
        username: fixed user name for TURN.
        credential: password for TURN.
        command: program, and its arguments, that prints a temporary credential.
        url: URL that returns a temporary credential.
    """

    urls: tuple[str, ...] = ()
    username: str = ""
    credential: str = ""
    command: tuple[str, ...] = ()
    url: str = ""


class IceServers:
    """Servers of new peers; credentials are renewed after half of their lifetime."""

    def __init__(self, source: IceSource, now: Callable[[], float] = monotonic) -> None:
        self._source = source
        self._now = now
        self._found: tuple[IceServer, ...] = ()
        self._until = 0.0
        self._lock = anyio.Lock()

    async def find(self) -> tuple[IceServer, ...]:
        """Return the servers.

        Raises:
            NoIceServers: the command or the URL gives none; says why.
        """
        source = self._source
        if not source.command and not source.url:
            return _with_credential(source.urls, source.username, source.credential)
        async with self._lock:  # Peers that are opened at the same time share one request.
            if self._now() >= self._until:
                text = await (self._run() if source.command else self._fetch())
                self._found, ttl = read_credential(text, source.urls)
                self._until = self._now() + REUSED * ttl
            return self._found

    async def _run(self) -> bytes:
        command = self._source.command
        try:
            with anyio.fail_after(SECONDS):
                done = await anyio.run_process(command, check=False)
        except TimeoutError:
            raise NoIceServers(f"{command[0]} gave no credential within {SECONDS:g} s") from None
        except OSError as error:
            raise NoIceServers(f"{command[0]} cannot be run: {error.strerror}") from error
        if done.returncode:
            raise NoIceServers(f"{command[0]} gave no credential: it ended with {done.returncode}")
        return done.stdout

    async def _fetch(self) -> bytes:
        try:
            return await anyio.to_thread.run_sync(_get, self._source.url, abandon_on_cancel=True)
        except (OSError, ValueError) as error:
            raise NoIceServers(f"{self._source.url} gave no credential: {error}") from error


def _get(url: str) -> bytes:
    try:
        with urllib.request.urlopen(
            url, timeout=SECONDS
        ) as answer:  # The settings allow http and https alone.
            body: bytes = answer.read(ANSWER_BYTES + 1)
    except urllib.error.HTTPError as error:
        with error:
            raise OSError(f"it answers with HTTP status {error.code}") from None
    return body


def read_credential(text: bytes, urls: Sequence[str]) -> tuple[tuple[IceServer, ...], float]:
    """Read a credential.

    Args:
        urls: URLs of the servers, in addition to those that the credential names.

    Returns:
        The servers, and the lifetime of the credential in seconds.

    Raises:
        NoIceServers: it cannot be used; says why.
    """
    try:
        found = json.loads(text) if len(text) <= ANSWER_BYTES else None
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise NoIceServers('a TURN credential is JSON like {"username": "…", "password": "…", "ttl": 600}')
    username, password, ttl = found.get("username"), found.get("password"), found.get("ttl", 60)
    named = found.get("uris", [])
    if not isinstance(username, str) or not isinstance(password, str):
        raise NoIceServers("the TURN credential has no `username` and `password`")
    if isinstance(ttl, bool) or not isinstance(ttl, int | float) or not 1 <= ttl <= 10_000_000:
        raise NoIceServers(f"the TURN credential has the `ttl` {ttl!r:.40}: expected 1 to 10,000,000 seconds")
    if not isinstance(named, list) or len(named) > MOST_SERVERS:
        raise NoIceServers(f"the TURN credential has `uris` that are no list of {MOST_SERVERS} or fewer")
    try:
        chosen = tuple(check_ice_url(str(each)) for each in named)
    except BadIceServer as error:
        raise NoIceServers(f"the TURN credential: {error}") from error
    return _with_credential((*urls, *chosen), username, password), float(ttl)


def _with_credential(urls: Sequence[str], username: str, credential: str) -> tuple[IceServer, ...]:
    return tuple(
        IceServer(url, username, credential) if url.startswith("turn") else IceServer(url) for url in urls
    )
