"""Admission of clients, and texts of operators: headers, tokens, origins, settings."""

from __future__ import annotations

import logging
from urllib.parse import unquote_plus

from rwt.access.admission import Admission
from rwt.access.audit import Audit
from rwt.access.settings import AuthSettings, OriginSettings, RoleSettings, SettingsError, TokenSettings
from rwt.settings.models import Settings
from rwt.settings.sources import load_settings
from rwt_transports.endpoint import PeerInfo
from rwt_transports.errors import Refused

TOKEN = "a-token-of-some-length"
NOW = 1_700_000_000.0

_OPEN = Settings()
_GUARDED = Settings.model_validate(
    {
        "auth": AuthSettings(
            tokens={"pilot": TokenSettings.model_validate({"token": TOKEN, "role": "pilot"})}
        ),
        "roles": {"pilot": RoleSettings(publish=("/cmd_*", "[!x]"), subscribe=("**",))},
        "origins": OriginSettings(allow=("https://*.example.com",)),
    }
)


def admission(data: bytes) -> None:
    """A connection's request: the first byte chooses the server, then come the path and headers, a line
    each."""
    logging.getLogger("rwt.bridge").setLevel(logging.CRITICAL)
    door = Admission(_GUARDED if data[0] & 1 else _OPEN, lambda: NOW, lambda: NOW, Audit())
    path, *lines = data[1:].decode("latin-1").split("\n")
    pairs = (line.partition(":") for line in lines)
    headers = {name.lower(): value.strip() for name, _, value in pairs}
    info = PeerInfo("ws", "10.0.0.7", 4321, path, headers)
    try:
        role = door.admit(info, loopback=bool(data[0] & 2))
    except Refused as refused:
        assert 400 <= refused.status < 500 and 0 < len(str(refused)) < 2_000
        assert str(refused).isprintable()
        return
    if role is not None and data[0] & 1:
        assert TOKEN in unquote_plus(data.decode("latin-1")), "let in without the token"
        role.sees_topic(path)


def settings(data: bytes) -> None:
    """Settings as the environment holds them, a variable a line."""
    pairs = (line.partition("=") for line in data.decode("utf-8", "replace").split("\n"))
    variables = {f"RWT_{name}": value for name, _, value in pairs if name != "CONFIG"}
    try:
        found = load_settings(environment=variables)
    except SettingsError as error:
        assert str(error)
        return
    assert Settings.model_validate(found.settings.model_dump()) == found.settings
