"""Admission of connections before they open: origin, bearer token and role."""

from __future__ import annotations

import logging
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING

from rwt.access.audit import Audit, LineRate
from rwt.access.credentials import (
    ROSAUTH,
    Rosauth,
    digests_of,
    presented_token,
    role_of_token,
    rosauth_of,
)
from rwt.access.errors import NotAuthenticated
from rwt.access.origins import NO_SITE, Origins
from rwt.access.roles import Role, roles
from rwt.access.settings import SettingsError
from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rwt.access.settings import AccessSettings
    from rwt_transports.endpoint import PeerInfo


_HOW = (
    "send the header `Authorization: Bearer TOKEN`, `?token=TOKEN`, or the subprotocols `rwt, bearer.TOKEN`"
)


class Admission:
    """Admission of the connections of one server.

    Attributes:
        roles: every role, by name.
        rosauth: verifier of `auth` ops; None without a secret.
        default_role: role of clients without credentials; None: credentials are required.
        refused: number of refused connections and requests by reason: `token`, `auth` (rosauth), `origin`,
            `role`, `work`.

    Args:
        now: returns the seconds since 1970.
        monotonic: returns the seconds of a steady clock.

    Raises:
        SettingsError: a token or the rosauth secret cannot be read, or two tokens are the same.
    """

    def __init__(
        self,
        settings: AccessSettings,
        now: Callable[[], float],
        monotonic: Callable[[], float],
        audit: Audit,
    ) -> None:
        self._audit = audit
        self._now = now
        self._monotonic = monotonic
        self._log_rate = LineRate(per_second=10, burst=100)
        self.refused: Counter[str] = Counter(token=0, auth=0, origin=0, role=0, work=0)
        self.rosauth: Rosauth | None = None
        self._is_open = True
        self.prepare(settings)()

    def prepare(self, settings: AccessSettings) -> Callable[[], None]:
        """Return the function that replaces tokens, roles, origins and the rosauth secret; it does not fail.

        Raises:
            SettingsError: a token or the rosauth secret cannot be read, or every client would become
                `admin`, without a restart or `auth.default_role` that says so.
        """
        if settings.auth.is_open and not self._is_open:
            raise SettingsError(
                "`auth`: without credentials and `auth.default_role`, every client would be `admin`; if that"
                ' is intended, set `auth.default_role = "admin"`, or to a role that may less',
                ("auth",),
            )
        known = roles(settings)
        rosauth = rosauth_of(settings.auth, known, self._now)
        return partial(self._replace, settings, known, rosauth, digests_of(settings.auth))

    def _replace(
        self,
        settings: AccessSettings,
        known: Mapping[str, Role],
        rosauth: Rosauth | None,
        digests: Mapping[str, bytes],
    ) -> None:
        auth = settings.auth
        self._keeps_secret = False
        if rosauth is not None and self.rosauth is not None:
            rosauth.take_used_macs(self.rosauth)
            self._keeps_secret = rosauth.has_secret_of(self.rosauth)
        self._is_open = auth.is_open
        self.roles = known
        self.rosauth = rosauth
        self._tokens = [
            (digests[name], known[token.role].given_by(name)) for name, token in auth.tokens.items()
        ]
        name = auth.role_without_credentials
        self.default_role: Role | None = known[name] if name else None
        self._origins = Origins(settings.origins.allow)

    def changeable(self) -> Mapping[str, object]:
        """Return what a reload may change, by the key of the setting; for comparison."""
        return {
            **{f"roles.{name}": role.globs for name, role in self.roles.items()},
            **{f"auth.tokens.{role.credential}": (digest, role.name) for digest, role in self._tokens},
            "auth.default_role": self.default_role and self.default_role.name,
            "auth.rosauth_secret_file": self.rosauth is not None,
        }

    def role_now(self, info: PeerInfo, by_auth: str | None) -> Role:
        """Return the role of a connected client after the settings were replaced.

        Args:
            by_auth: role granted by an `auth` op, if any.

        Raises:
            Refused: the token is no longer known, the secret of rosauth is another, or credentials are
                required now.
        """
        if by_auth is None:
            role = self._role(info)
        else:
            self.role_of_token(info)  # Raises if the client has lost its token.
            known = self.roles.get(by_auth) if self._keeps_secret else None
            role = None if known is None else known.given_by(ROSAUTH, is_token=False)
        if role is None:
            raise self._refused(info, 401, "the server's settings have changed: authenticate again")
        return role

    def admit(self, info: PeerInfo, *, loopback: bool) -> Role | None:
        """Admit a connection.

        Args:
            loopback: True if its listener can only be reached from this machine.

        Returns:
            The role of the client; None if it must first authenticate by an `auth` op.

        Raises:
            Refused: the connection is refused with status 401 or 403; the text names the setting.
        """
        self._check_origin(info, loopback=loopback)
        return self._role(info)

    def role_of(self, info: PeerInfo) -> Role | None:
        """Return the role of an HTTP request by its token, or the default role; None if there is neither.

        Raises:
            Refused: the token is unknown.
        """
        return self.role_of_token(info) or self.default_role

    def expected_role(self, info: PeerInfo) -> Role | None:
        """Return the role that :meth:`role_of` will return; None if it will refuse the request.

        For requests that wait to be read: nothing is logged.
        """
        try:
            token = presented_token(info)
        except NotAuthenticated:
            return None
        return self.default_role if token is None else role_of_token(token, self._tokens)

    def credential_of(self, info: PeerInfo) -> str | None:
        """Return the name of the credential that a connection or request presents; empty if it needs none.

        Returns None if it is not admitted, or only by a later `auth` op. Unlike :meth:`role_of`, it neither
        raises nor logs.
        """
        role = self.expected_role(info)
        return None if role is None else role.credential

    def allows_page(self, origin: str, headers: Mapping[str, str], *, loopback: bool) -> bool:
        """Return True if the web page of an origin may connect; an empty one is that of no page."""
        return self._origins.allows(origin, headers.get("host", ""), loopback=loopback)

    def _check_origin(self, info: PeerInfo, *, loopback: bool) -> None:
        origin = info.headers.get("origin", "")
        if self.allows_page(origin, info.headers, loopback=loopback):
            return
        shown = origin if origin.isprintable() else ascii(origin)
        hint = ": serve the page over http://, or list that origin" if origin in NO_SITE else ""
        raise self._refused(info, 403, f"pages of {shown[:200]} may not connect here{hint} (origins.allow)")

    def _role(self, info: PeerInfo) -> Role | None:
        role = self.role_of(info)
        if role is None and self.rosauth is None:
            raise self.refused_without_token(info, "auth.tokens")
        return role

    def refused_without_token(self, info: PeerInfo, setting: str) -> Refused:
        """Count and log the refusal of a client without a token, and return it."""
        return self._refused(info, 401, f"a bearer token is needed ({setting}): {_HOW}", logging.INFO)

    def role_of_token(self, info: PeerInfo) -> Role | None:
        """Return the role of an HTTP request by its token; None without a token.

        Raises:
            Refused: the token is unknown.
        """
        try:
            token = presented_token(info)
        except NotAuthenticated as error:
            raise self._refused(info, 401, str(error)) from None
        if token is None:
            return None
        role = role_of_token(token, self._tokens)
        if role is None:
            raise self._refused(info, 401, "this bearer token is not known here (auth.tokens)")
        return role

    def log_refusal(self, kind: str, info: PeerInfo, reason: str, level: int = logging.WARNING) -> None:
        """Count and log a refusal; the rate limit is for all connections together.

        Args:
            kind: key of :attr:`refused`.
            level: level of the line: `INFO` for a client without a token, as each browser is at first.
        """
        self.refused[kind] += 1
        if self._log_rate.admit(self._monotonic()):
            text = f"turned {info.address or info.transport} away: {reason}{self._log_rate.note()}"
            self._audit.write(level, "%s", text)

    def _refused(self, info: PeerInfo, status: int, reason: str, level: int = logging.WARNING) -> Refused:
        self.log_refusal("token" if status == 401 else "origin", info, reason, level)
        headers = {"WWW-Authenticate": 'Bearer realm="rosbridge"'} if status == 401 else {}
        return Refused(status, reason, headers)
