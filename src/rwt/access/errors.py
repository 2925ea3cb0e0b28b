"""Errors of `rwt.access` about a client; gateways send their text to the client.

* :exc:`AccessError`

  * :exc:`NotAuthenticated`: the credentials are invalid.
  * :exc:`NotAllowed`: the client's role does not allow this.
  * :exc:`QuotaExceeded`: a limit of the client is reached.
  * :exc:`GateRefused`: a rule of the gate rejects this now.

A connection that is refused before it opens gets :exc:`rwt_transports.errors.Refused`, and one of a site that
may not connect its subclass :exc:`OriginRefused`; invalid settings raise
:exc:`rwt.access.settings.SettingsError`.
"""

from __future__ import annotations

from rwt_transports.errors import Refused


class AccessError(Exception):
    """Base of every error about a client. The text names the setting that decides."""


class NotAuthenticated(AccessError):
    """The credentials are invalid. The text gives the reason, as far as the sender may know it."""


class NotAllowed(AccessError):
    """The client's role does not allow this."""


class QuotaExceeded(AccessError):
    """A limit of the client is reached."""


class OriginRefused(Refused):
    """Pages of this site may not connect or act; the setting `origins.allow` decides."""


class GateRefused(AccessError):
    """A rule of the gate rejects this now.

    Attributes:
        rule: key of the rule in the settings, such as `gate.rules.drive`; empty if no rule decided.
    """

    def __init__(self, text: str, rule: str = "") -> None:
        super().__init__(f"{text} ({rule})" if rule else text)
        self.rule = rule
