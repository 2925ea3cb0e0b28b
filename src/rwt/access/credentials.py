"""Who a client is: `auth` as rosauth computes it, and bearer tokens. Both give a role."""

from __future__ import annotations

import hashlib
import heapq
import hmac
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qsl

from rwt.access.errors import NotAuthenticated
from rwt.access.settings import SettingsError

if TYPE_CHECKING:
    from rwt.access.roles import Role
    from rwt.access.settings import AuthSettings, TokenSettings
    from rwt_protocol import ops
    from rwt_transports.endpoint import PeerInfo

SECRET_LENGTH: Final = 16
"""Characters in rosauth's secret (AUT-05)."""

#: Accepted macs that are remembered until they expire. Only who holds the secret can fill this.
_MOST_REMEMBERED: Final = 10_000

#: Seconds since 1970 beyond which a time is as wrong as can be; Python's floats are exact up to here.
_LATEST: Final = 2**53

_BEARER: Final = re.compile(r"bearer +(\S+)", re.IGNORECASE)

_SUBPROTOCOL_TOKEN: Final = "bearer."
_QUERY_NAMES: Final = ("token", "access_token")


def read_secret(path: Path) -> str:
    """The secret that this server shares with rosauth's clients: the file's first line.

    Raises:
        SettingsError: the file cannot be read, or its first line has not exactly 16 characters (AUT-05).
    """
    where = f"auth.rosauth_secret_file: {path}"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise SettingsError(f"{where}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{where}: is not a text in UTF-8") from error
    secret = lines[0] if lines else ""
    if len(secret) != SECRET_LENGTH:
        raise SettingsError(
            f"{where}: the first line has {len(secret)} characters; rosauth wants exactly {SECRET_LENGTH}"
        )
    return secret


def mac_of(secret: str, op: ops.Auth) -> str:
    """The mac that belongs to an `auth` op: SHA-512 over all of it, 128 lower-case hex digits (AUT-05)."""
    text = f"{secret}{op.client}{op.dest}{op.rand}{op.t}{op.level}{op.end}"
    return hashlib.sha512(text.encode("utf-8", "surrogatepass")).hexdigest()


class Rosauth:
    """Judges `auth` ops by a shared secret.

    Args:
        secret: 16 characters.
        allowed_delta: seconds by which ``t`` may differ from now.
        now: seconds since 1970.
        role_for: the role of a level; None refuses it.
    """

    def __init__(
        self,
        secret: str,
        allowed_delta: float,
        now: Callable[[], float],
        role_for: Callable[[str], Role | None],
    ) -> None:
        self._secret = secret
        self._allowed_delta = allowed_delta
        self._now = now
        self._role_for = role_for
        self._seen: set[str] = set()
        self._expiry: list[tuple[float, str]] = []

    def authenticate(self, op: ops.Auth) -> Role:
        """The role of whoever sent `op`.

        Nothing else is looked at before the mac is right, so that only holders of the secret learn more.

        Raises:
            NotAuthenticated: the mac is wrong or was used before, or the time is not now (AUT-06, AUT-07).
        """
        expected = mac_of(self._secret, op)
        if not hmac.compare_digest(expected.encode(), op.mac.encode("utf-8", "surrogatepass")):
            raise NotAuthenticated("auth: the mac is wrong")
        now = self._now()
        # Whole seconds count, so 4.9 s pass a limit of 5 and 5.0 do not (AUT-06).
        difference = abs(now - max(-_LATEST, min(op.t, _LATEST)))
        if int(difference) >= self._allowed_delta:
            raise NotAuthenticated(
                f"auth: t is {difference:.0f} s off this server's clock (auth.allowed_time_delta)"
            )
        if op.end <= now:
            raise NotAuthenticated("auth: this has ended: `end` is in the past")
        role = self._role_for(op.level)
        if role is None:
            raise NotAuthenticated(f"auth: the level {op.level!r} names no role (auth.rosauth_role)")
        self._use(expected, min(op.end, op.t + self._allowed_delta + 1), now)
        return role

    def remember_those_of(self, other: Rosauth) -> None:
        """Take over from `other` the macs that must not be used again."""
        self._seen, self._expiry = other._seen, other._expiry

    def _use(self, mac: str, until: float, now: float) -> None:
        """Let a mac be good once; it is remembered for as long as it would be good."""
        while self._expiry and self._expiry[0][0] < now:
            self._seen.discard(heapq.heappop(self._expiry)[1])
        if mac in self._seen:
            raise NotAuthenticated("auth: this was used before; compute a new mac for each connection")
        if len(self._seen) >= _MOST_REMEMBERED:
            raise NotAuthenticated("auth: too many clients at a time; try again in some seconds")
        self._seen.add(mac)
        heapq.heappush(self._expiry, (until, mac))


class Tokens:
    """The bearer tokens that are known, and the roles that they give."""

    def __init__(self, tokens: Mapping[str, TokenSettings], roles: Mapping[str, Role]) -> None:
        self._known = [(_hash_of(token), roles[token.role]) for token in tokens.values()]

    def __bool__(self) -> bool:
        return bool(self._known)

    def role_of(self, token: str) -> Role | None:
        """The role that a token gives; None if it is not known. Takes the same time whichever it is."""
        presented = hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()
        found: Role | None = None
        for known, role in self._known:
            if hmac.compare_digest(known, presented):
                found = role
        return found


def presented_token(info: PeerInfo) -> str | None:
    """The bearer token that came with a connection, None if there is none.

    It may come in the header ``Authorization: Bearer …`` (RFC 6750 section 2.1), in the query as ``token`` or
    ``access_token`` (section 2.3), or, for browsers, which can set neither a header nor hide a query, as the
    WebSocket subprotocol ``bearer.…`` beside ``rwt``, which is the one that the server then selects.

    Raises:
        NotAuthenticated: there are several, and they differ.
    """
    found = {token for token in (*_in_header(info), *_in_query(info), *_in_subprotocols(info)) if token}
    if len(found) > 1:
        raise NotAuthenticated("several different bearer tokens came with this connection; send one")
    return found.pop() if found else None


def _in_header(info: PeerInfo) -> list[str]:
    match = _BEARER.fullmatch(info.headers.get("authorization", "").strip())
    return [match[1]] if match else []


def _in_query(info: PeerInfo) -> list[str]:
    # Cut by hand: urlsplit drops line breaks and tabs, and a token with them in it is another token.
    query = info.path.partition("#")[0].partition("?")[2]
    try:
        return [value for name, value in parse_qsl(query, max_num_fields=100) if name in _QUERY_NAMES]
    except ValueError:
        return []


def _in_subprotocols(info: PeerInfo) -> list[str]:
    offered = (name.strip() for name in info.headers.get("sec-websocket-protocol", "").split(","))
    return [name.removeprefix(_SUBPROTOCOL_TOKEN) for name in offered if name.startswith(_SUBPROTOCOL_TOKEN)]


def _hash_of(token: TokenSettings) -> bytes:
    if token.sha256 is not None:
        return bytes.fromhex(token.sha256.get_secret_value())
    plain = token.token.get_secret_value() if token.token else ""
    return hashlib.sha256(plain.encode()).digest()


def rosauth_of(
    settings: AuthSettings, roles: Mapping[str, Role], configured: bool, now: Callable[[], float]
) -> Rosauth | None:
    """The judge of `auth` ops, None where no secret is configured.

    Args:
        settings: who may come in.
        roles: every role.
        configured: whether the operator has made roles: then a level that names none is refused by default.
        now: seconds since 1970.

    Raises:
        SettingsError: the secret cannot be had.
    """
    if settings.rosauth_secret_file is None:
        return None
    otherwise = settings.rosauth_role or (None if configured else "admin")
    fallback = roles[otherwise] if otherwise else None
    secret = read_secret(settings.rosauth_secret_file)
    return Rosauth(secret, settings.allowed_time_delta, now, lambda level: roles.get(level, fallback))
