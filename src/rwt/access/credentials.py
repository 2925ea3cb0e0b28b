"""Credentials of clients: `auth` ops of rosauth, and bearer tokens. Both give a role."""

from __future__ import annotations

import hashlib
import heapq
import hmac
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qsl

from rwt.access.errors import NotAuthenticated
from rwt.access.settings import (
    TOKEN,
    AuthSettings,
    SettingsError,
    TokenSettings,
    check_tokens_differ,
    digest_of,
)

if TYPE_CHECKING:
    from rwt.access.roles import Role
    from rwt_protocol import ops
    from rwt_transports.endpoint import PeerInfo

#: Number of characters of the rosauth secret (AUT-05).
SECRET_LENGTH: Final = 16

#: Maximum number of accepted MACs kept until they expire. Only holders of the secret can reach it.
_MAX_MACS: Final = 10_000

#: Largest time, in seconds since 1970, that is told apart: floats are exact up to here.
_MAX_SECONDS: Final = 2**53

_BEARER: Final = re.compile(r"bearer +(\S+)", re.IGNORECASE)

#: Shown in place of a token's name for clients that authenticate by an `auth` op, which names nobody.
ROSAUTH: Final = "rosauth"

#: The MAC covers the concatenated members, without separators, so a client can move characters from one to
#: the next. Numbers delimit the level on both sides, and remain what they are if it has no digit.
_DIGIT: Final = re.compile(r"[0-9]")

_SUBPROTOCOL_TOKEN: Final = "bearer."
_QUERY_NAMES: Final = ("token", "access_token")


def _first_line(path: Path, where: str) -> str:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise SettingsError(f"{where}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{where}: is not a text in UTF-8") from error
    return lines[0] if lines else ""


def read_secret(path: Path) -> str:
    """Return the secret shared with rosauth clients: the first line of a file.

    Raises:
        SettingsError: the file cannot be read, or its first line does not have 16 characters (AUT-05).
    """
    where = f"auth.rosauth_secret_file: {path}"
    secret = _first_line(path, where)
    if len(secret) != SECRET_LENGTH:
        raise SettingsError(
            f"{where}: the first line has {len(secret)} characters; rosauth wants exactly {SECRET_LENGTH}"
        )
    return secret


def digests_of(settings: AuthSettings) -> Mapping[str, bytes]:
    """Return the SHA-256 of each token, by its name; token files are read.

    Raises:
        SettingsError: a file cannot be read or has no token, or two tokens are the same.
    """
    digests = {name: each.digest or _digest_in_file(name, each) for name, each in settings.tokens.items()}
    try:
        check_tokens_differ(digests)
    except ValueError as error:
        raise SettingsError(str(error)) from None
    return digests


def _digest_in_file(name: str, token: TokenSettings) -> bytes:
    assert token.token_file is not None
    where = f"`auth.tokens.{name}.token_file`: {token.token_file}"
    plain = _first_line(token.token_file, where)
    if TOKEN.fullmatch(plain) is None:  # The error does not quote what may be a secret.
        raise SettingsError(f"{where}: expected a first line of 16 to 256 of A-Z a-z 0-9 - . _ ~")
    return digest_of(plain)


def mac_of(secret: str, op: ops.Auth) -> str:
    """Return the MAC of an `auth` op: SHA-512 over all fields, 128 lower-case hex digits (AUT-05)."""
    text = f"{secret}{op.client}{op.dest}{op.rand}{op.t}{op.level}{op.end}"
    return hashlib.sha512(text.encode("utf-8", "surrogatepass")).hexdigest()


class Rosauth:
    """Verifier of `auth` ops by a shared secret.

    Args:
        allowed_delta: maximum difference between ``t`` and now, in seconds.
        now: returns the seconds since 1970.
        role_for: returns the role of a level; None to reject it.
        most_ahead: maximum of ``end - t``, in seconds.
    """

    def __init__(
        self,
        secret: str,
        allowed_delta: float,
        now: Callable[[], float],
        role_for: Callable[[str], Role | None],
        most_ahead: float = 86_400.0,
    ) -> None:
        self._secret = secret
        self._most_ahead = most_ahead
        self._allowed_delta = allowed_delta
        self._now = now
        self._role_for = role_for
        self._seen: set[str] = set()
        self._expiry: list[tuple[float, str]] = []

    def authenticate(self, op: ops.Auth) -> Role:
        """Return the role of the sender of `op`.

        The MAC is checked first, so that only holders of the secret learn of other errors.

        Raises:
            NotAuthenticated: the MAC is wrong or was used before, the time is out of range (AUT-06, AUT-07),
                or the level has a digit or no role.
        """
        expected = mac_of(self._secret, op)
        if not hmac.compare_digest(expected.encode(), op.mac.encode("utf-8", "surrogatepass")):
            raise NotAuthenticated("auth: the mac is wrong")
        now = self._now()
        # Whole seconds count: 4.9 s pass a limit of 5, 5.0 s do not (AUT-06).
        difference = abs(now - max(-_MAX_SECONDS, min(op.t, _MAX_SECONDS)))
        if int(difference) >= self._allowed_delta:
            raise NotAuthenticated(
                f"auth: t is {difference:.0f} s off this server's clock (auth.allowed_time_delta)"
            )
        if op.end <= now:
            raise NotAuthenticated("auth: this has ended: `end` is in the past")
        if op.end - op.t > self._most_ahead:
            raise NotAuthenticated(
                f"auth: `end` is more than {self._most_ahead:g} s after t (auth.rosauth_end_seconds)"
            )
        if _DIGIT.search(op.level):
            raise NotAuthenticated(
                f"auth: the level {op.level[:100]!r} has a digit, which could belong to `t` or `end`"
            )
        role = self._role_for(op.level)
        if role is None:
            raise NotAuthenticated(
                f"auth: the level {op.level[:100]!r} names no role (roles, auth.rosauth_role)"
            )
        self._use(expected, min(op.end, op.t + self._allowed_delta + 1), now)
        return role

    def has_secret_of(self, other: Rosauth) -> bool:
        """True if clients of another verifier need not authenticate again."""
        return hmac.compare_digest(self._secret.encode(), other._secret.encode())

    def take_used_macs(self, other: Rosauth) -> None:
        """Take over the MACs of another verifier that must not be used again."""
        self._seen, self._expiry = other._seen, other._expiry

    def _use(self, mac: str, until: float, now: float) -> None:
        """Use up a MAC; it is kept until it expires."""
        while self._expiry and self._expiry[0][0] < now:
            self._seen.discard(heapq.heappop(self._expiry)[1])
        if mac in self._seen:
            raise NotAuthenticated("auth: this was used before; compute a new mac for each connection")
        if len(self._seen) >= _MAX_MACS:
            raise NotAuthenticated("auth: too many clients at a time; try again in some seconds")
        self._seen.add(mac)
        heapq.heappush(self._expiry, (until, mac))


def role_of_token(token: str, known: Iterable[tuple[bytes, Role]]) -> Role | None:
    """Return the role of a bearer token, in constant time; None if its digest is not among the known."""
    presented = digest_of(token)
    found: Role | None = None
    for digest, role in known:
        if hmac.compare_digest(digest, presented):
            found = role
    return found


def presented_token(info: PeerInfo) -> str | None:
    """Return the bearer token of a connection; None if it has none.

    A token comes in the header ``Authorization: Bearer …`` (RFC 6750 section 2.1) or in the query as
    ``token`` or ``access_token`` (section 2.3). Browsers cannot set the header of a WebSocket: they may offer
    the subprotocol ``bearer.…`` together with ``rwt``, which the server selects.

    Raises:
        NotAuthenticated: there are several different tokens.
    """
    found = {token for token in (*_in_header(info), *_in_query(info), *_in_subprotocols(info)) if token}
    if len(found) > 1:
        raise NotAuthenticated("several different bearer tokens came with this connection; send one")
    return found.pop() if found else None


def _in_header(info: PeerInfo) -> list[str]:
    match = _BEARER.fullmatch(info.headers.get("authorization", "").strip())
    return [match[1]] if match else []


def _in_query(info: PeerInfo) -> list[str]:
    # Not urlsplit(): it removes line breaks and tabs, which would make another token.
    query = info.path.partition("#")[0].partition("?")[2]
    try:
        return [value for name, value in parse_qsl(query, max_num_fields=100) if name in _QUERY_NAMES]
    except ValueError:
        return []


def _in_subprotocols(info: PeerInfo) -> list[str]:
    offered = (name.strip() for name in info.headers.get("sec-websocket-protocol", "").split(","))
    return [name.removeprefix(_SUBPROTOCOL_TOKEN) for name in offered if name.startswith(_SUBPROTOCOL_TOKEN)]


def rosauth_of(settings: AuthSettings, roles: Mapping[str, Role], now: Callable[[], float]) -> Rosauth | None:
    """Return the verifier of `auth` ops; None if no secret is configured.

    Args:
        now: returns the seconds since 1970.

    Raises:
        SettingsError: the secret cannot be read.
    """
    if settings.rosauth_secret_file is None:
        return None
    fallback = roles[settings.rosauth_role] if settings.rosauth_role else None
    secret = read_secret(settings.rosauth_secret_file)

    def role_for(level: str) -> Role | None:
        role = roles.get(level, fallback)
        return None if role is None else role.given_by(ROSAUTH, is_token=False)

    return Rosauth(secret, settings.allowed_time_delta, now, role_for, settings.rosauth_end_seconds)
