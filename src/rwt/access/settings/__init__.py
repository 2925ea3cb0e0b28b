"""Settings of access control: the models alone."""

from rwt.access.settings.models import (
    BUILT_IN_ROLES,
    CALL_SECONDS,
    LINGER_SECONDS,
    AccessSettings,
    AuthSettings,
    ClientLimits,
    OriginSettings,
    PlainToken,
    RoleSettings,
    SettingsError,
    TlsSettings,
    TokenSettings,
)
from rwt.access.settings.types import (
    MIB,
    Bytes,
    Count,
    CountOrNone,
    Globs,
    Seconds,
    SecondsOrNone,
    Table,
)

__all__ = [
    "BUILT_IN_ROLES",
    "CALL_SECONDS",
    "LINGER_SECONDS",
    "MIB",
    "AccessSettings",
    "AuthSettings",
    "Bytes",
    "ClientLimits",
    "Count",
    "CountOrNone",
    "Globs",
    "OriginSettings",
    "PlainToken",
    "RoleSettings",
    "Seconds",
    "SecondsOrNone",
    "SettingsError",
    "Table",
    "TlsSettings",
    "TokenSettings",
]
