"""The `auth` op, computed when it is sent because its times must be close to now (AUT-05, AUT-06)."""

from __future__ import annotations

import hashlib
import secrets
import time

from rosbridge_conformance.suite.values import Json


def fill_auth(body: Json, secret: str | None) -> Json:
    """Replace `{"$auth": {…}}` by an `auth` frame; other frames stay unchanged.

    What is inside `$auth` overrides fields before the mac is made: `t` and `end` are seconds from now; `mac`
    is put in as it stands, `mac_length` cuts the right one short, `upper` writes it in capitals, `wrong_from`
    alters all digits from that one on, and null leaves a field out.
    """
    if not isinstance(body, dict) or set(body) != {"$auth"}:
        return body
    wanted = body["$auth"]
    given = dict(wanted) if isinstance(wanted, dict) else {}
    now = int(time.time())
    fields: dict[str, Json] = {
        "client": "192.168.0.10", "dest": "192.168.0.2", "rand": secrets.token_hex(6), "level": "admin"
    }  # fmt: skip
    for name, usual in (("t", 0), ("end", 120)):
        offset = given.pop(name, usual)
        fields[name] = now + int(offset) if isinstance(offset, int | float) else offset
    fields |= {key: value for key, value in given.items() if key in fields}
    mac = authentication_mac(secret or "", fields)
    cut = given.get("mac_length")
    mac = mac[:cut] if isinstance(cut, int) else mac
    mac = mac.upper() if given.get("upper") else mac
    start = given.get("wrong_from")
    if isinstance(start, int):
        mac = mac[:start] + "".join("0" if digit != "0" else "1" for digit in mac[start:])
    fields["mac"] = given.get("mac", mac)
    return {"op": "auth", **{key: value for key, value in fields.items() if value is not None}}


def authentication_mac(secret: str, fields: dict[str, Json]) -> str:
    """Return the lower-case hexadecimal SHA-512 of the fields joined as in rosauth (AUT-05)."""
    order = ("client", "dest", "rand", "t", "level", "end")
    return hashlib.sha512((secret + "".join(str(fields[name]) for name in order)).encode()).hexdigest()
