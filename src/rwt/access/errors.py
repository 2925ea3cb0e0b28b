"""Everything that `rwt.access` raises about a client; gateways tell the client its text.

* :exc:`AccessError`

  * :exc:`NotAuthenticated`: the credentials are not good.
  * :exc:`NotAllowed`: the client's role does not allow this.
  * :exc:`QuotaExceeded`: the client has as much as it may have.
  * :exc:`GateRefused`: a rule of the gate does not let this through now.

A connection that is turned away before it opens gets :exc:`rwt_transports.errors.Refused`, and settings that
cannot be used raise :exc:`rwt.access.settings.SettingsError`.
"""

from __future__ import annotations


class AccessError(Exception):
    """Base of every error about a client. The text names the setting that decides."""


class NotAuthenticated(AccessError):
    """The credentials are not good. The text says why, as far as the sender may know."""


class NotAllowed(AccessError):
    """The client's role does not allow this."""


class QuotaExceeded(AccessError):
    """The client has as much as it may have."""


class GateRefused(AccessError):
    """A rule of the gate does not let this through now.

    Attributes:
        rule: the key of the rule in the settings, such as `gate.rules.drive`; empty where it is the gate
            itself.
    """

    def __init__(self, text: str, rule: str = "") -> None:
        super().__init__(f"{text} ({rule})" if rule else text)
        self.rule = rule
