"""Who comes in, and as what: origin and bearer token; before a connection opens."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt.access.audit import LineRate
from rwt.access.credentials import Tokens, presented_token, rosauth_of
from rwt.access.errors import NotAuthenticated
from rwt.access.origins import NO_SITE, Origins
from rwt.access.roles import roles
from rwt_transports.errors import Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rwt.access.audit import Audit
    from rwt.access.credentials import Rosauth
    from rwt.access.roles import Role
    from rwt.access.settings import AccessSettings
    from rwt_transports.endpoint import PeerInfo


_HOW = (
    "send the header `Authorization: Bearer TOKEN`, `?token=TOKEN`, or the subprotocols `rwt, bearer.TOKEN`"
)


class Admission:
    """Decides on every connection of one server before it opens.

    Attributes:
        roles: every role, by name.
        rosauth: the judge of `auth` ops, None where there is no secret.
        default_role: the role of clients without credentials; None: they must have some.

    Args:
        settings: everything that is configured.
        now: seconds since 1970.
        monotonic: seconds on a clock that never goes back.
        audit: the log of refusals.

    Raises:
        SettingsError: the secret of rosauth cannot be had.
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
        self.rosauth: Rosauth | None = None
        self.reload(settings)

    def reload(self, settings: AccessSettings) -> None:
        """Go by other tokens, roles, origins and another secret from now on; the limits stay.

        Raises:
            SettingsError: the secret of rosauth cannot be had; then all stays as it was.
        """
        auth = settings.auth
        known: Mapping[str, Role] = roles(settings)
        rosauth = rosauth_of(auth, known, bool(settings.roles), self._now)
        if rosauth is not None and self.rosauth is not None:
            rosauth.remember_those_of(self.rosauth)
        self.roles = known
        self.rosauth = rosauth
        self._tokens = Tokens(auth.tokens, known)
        is_open = not self._tokens and rosauth is None
        name = auth.default_role or ("admin" if is_open else None)
        self.default_role: Role | None = known[name] if name else None
        self._origins = Origins(settings.origins.allow)

    def role_now(self, info: PeerInfo, by_auth: str | None) -> Role:
        """The role that a connected client has after :meth:`reload`.

        Args:
            info: what the transport knows of it.
            by_auth: the role that an `auth` op has given it, if one has.

        Raises:
            Refused: its token is not known any more, or it has to show what it has not shown.
        """
        if by_auth is None:
            role = self._role(info)
        else:
            role = None if self.rosauth is None else self.roles.get(by_auth)
        if role is None:
            raise self._refused(info, 401, "the server's settings have changed: authenticate again")
        return role

    def admit(self, info: PeerInfo, *, loopback: bool) -> Role | None:
        """Let a connection in.

        Args:
            info: what the transport knows of the other side.
            loopback: whether its listener is only reached from this machine.

        Returns:
            The client's role; None for one that must authenticate by an `auth` op before anything else.

        Raises:
            Refused: it may not come in, with status 401 or 403; the text names the setting.
        """
        self._check_origin(info, loopback=loopback)
        return self._role(info)

    def role_of(self, info: PeerInfo) -> Role | None:
        """The role that a request without a connection has, by its token; None where it has none.

        Raises:
            Refused: its token is not known.
        """
        return self._by_token(info) or self.default_role

    def role_of_token(self, info: PeerInfo) -> Role | None:
        """The role that a request's token gives; None where it shows none, or where there are no tokens.

        Raises:
            Refused: its token is not known.
        """
        return self._by_token(info)

    def allows_page(self, headers: Mapping[str, str], *, loopback: bool) -> bool:
        """Whether the web page that a request's ``Origin`` names may read what is here."""
        return self._origins.allows(headers.get("origin", ""), headers.get("host", ""), loopback=loopback)

    def _check_origin(self, info: PeerInfo, *, loopback: bool) -> None:
        if self.allows_page(info.headers, loopback=loopback):
            return
        origin = info.headers["origin"]
        shown = origin if origin.isprintable() else ascii(origin)
        hint = ": serve the page over http://, or list that origin" if origin in NO_SITE else ""
        raise self._refused(info, 403, f"pages of {shown[:200]} may not connect here{hint} (origins.allow)")

    def _role(self, info: PeerInfo) -> Role | None:
        role = self._by_token(info) or self.default_role
        if role is None and self.rosauth is None:
            raise self._refused(info, 401, f"a bearer token is needed (auth.tokens): {_HOW}")
        return role

    def _by_token(self, info: PeerInfo) -> Role | None:
        if not self._tokens:
            return None
        try:
            token = presented_token(info)
        except NotAuthenticated as error:
            raise self._refused(info, 401, str(error)) from None
        if token is None:
            return None
        role = self._tokens.role_of(token)
        if role is None:
            raise self._refused(info, 401, "this bearer token is not known here (auth.tokens)")
        return role

    def log_refusal(self, info: PeerInfo, reason: str) -> None:
        """Note that a connection was turned away; the rate is that of all connections together."""
        line = self._log_rate.admit(
            f"turned {info.address or info.transport} away: {reason}", self._monotonic()
        )
        if line is not None:
            self._audit.write(logging.WARNING, "%s", line)

    def _refused(self, info: PeerInfo, status: int, reason: str) -> Refused:
        self.log_refusal(info, reason)
        headers = {"WWW-Authenticate": 'Bearer realm="rosbridge"'} if status == 401 else {}
        return Refused(status, reason, headers)
