"""Write the part of docs/reference/protocol.md that lists every op, from the models.

Run it after a change of the models and commit what changed; `--check` only says whether the page is current:

    python tools/generate_protocol_reference.py [--check]
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from pathlib import Path

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from rwt_protocol.codecs import SELECTABLE
from rwt_protocol.error_text import Expected, model_in
from rwt_protocol.ops import OPS, ActionResult, Direction, Op, OpSpec, Qos, ServiceResponse
from rwt_protocol.ops.base import NoEffect, ReplyTo
from rwt_protocol.ops.topics import Compact
from rwt_protocol.payloads import EMPTY
from rwt_protocol.profiles import PROFILES

PAGE = Path(__file__).parent.parent / "docs" / "reference" / "protocol.md"
BEGIN = "<!-- begin of what tools/generate_protocol_reference.py writes -->\n"
END = "<!-- end of what tools/generate_protocol_reference.py writes -->\n"

GROUPS = {
    "Topics": ("advertise", "unadvertise", "publish", "subscribe", "unsubscribe"),
    "Services": ("call_service", "service_response", "advertise_service", "unadvertise_service"),
    "Actions": (
        "send_action_goal",
        "cancel_action_goal",
        "action_feedback",
        "action_result",
        "advertise_action",
        "unadvertise_action",
    ),
    "The connection": ("set_level", "status", "auth", "fragment", "png"),
}

_ARROWS = {
    Direction.TO_SERVER: "Client → server",
    Direction.TO_CLIENT: "Server → client",
    Direction.BOTH: "Both ways",
}


def render() -> str:
    """Everything between the two marks."""
    listed = sorted(name for names in GROUPS.values() for name in names)
    if listed != sorted(OPS):
        raise SystemExit(f"GROUPS and the models differ: {set(listed) ^ set(OPS)}")
    parts = []
    for group, names in GROUPS.items():
        parts.append(f"### {group}\n")
        parts += [_op(OPS[name]) for name in names]
    parts += [_quality_of_service(), _compact_messages()]
    return "\n".join(parts)


def _op(spec: OpSpec) -> str:
    lines = [f"#### {spec.name}\n", f"{_summary(spec.model)}\n", f"{_facts(spec)}\n"]
    return "\n".join([*lines, _table(spec.name, spec.model)])


def _facts(spec: OpSpec) -> str:
    facts = [f"{_ARROWS[spec.direction]}."]
    if spec.aliases:
        facts.append(f"Also accepted as {', '.join(f'`{alias}`' for alias in spec.aliases)}.")
    if spec.direction is not Direction.TO_CLIENT:
        facts.append(f"Refused with {_refusal(spec)}.")
    missing = [name for name, profile in PROFILES.items() if spec.name not in profile.ops]
    if missing:
        facts.append(f"Not in {_profile_names(missing)}.")
    facts += [f"Profile `{name}` ignores {fields}." for name, fields in _ignored(spec.name)]
    return " ".join(facts)


def _ignored(op: str) -> list[tuple[str, str]]:
    """Profiles that have the op, and the fields of it that they have not."""
    return [
        (name, ", ".join(f"`{field}`" for field in sorted(profile.without[op])))
        for name, profile in PROFILES.items()
        if op in profile.ops and op in profile.without
    ]


def _profile_names(names: list[str]) -> str:
    word = "profile" if len(names) == 1 else "profiles"
    return f"{word} {' and '.join(f'`{name}`' for name in names)}"


def _refusal(spec: OpSpec) -> str:
    answer = spec.refuse(ReplyTo(spec.name, "1", "/name"), "why", "error")
    if isinstance(answer, ServiceResponse | ActionResult):
        return f'`{answer.op}` with `"result": false` and the reason as `values`'
    return f"`{answer.op}`, where the client hears it ([when](#status))"


def _table(op: str, model: type[BaseModel]) -> str:
    rows = ["| field | holds | default | meaning |", "|---|---|---|---|"]
    described = _attributes(model)
    for name, field in model.model_fields.items():
        if name != "op":
            meaning = _meaning(f"{op}.{name}", field, described.get(name))
            rows.append(f"| `{name}` | {_holds(field)} | {_default(field)} | {meaning} |")
    return "\n".join(rows) + "\n"


def _meaning(where: str, field: FieldInfo, described: str | None) -> str:
    for item in field.metadata:
        if isinstance(item, NoEffect):
            return f"Taken, and without effect: {item.reason}."
    if described is None:
        raise SystemExit(f"{where} has no description: add one to its model")
    if where == "subscribe.compression":
        words = ", ".join(f"`{encoding.name}`" for encoding in SELECTABLE)
        return f"{described} [Known](encodings.md) are {words}."
    if model_in(field.annotation) is Qos:
        return f"{described} [Policies](#quality-of-service)."
    if model_in(field.annotation) is Compact:
        return f"{described} [Members](#compact-messages)."
    return described


def _holds(field: FieldInfo) -> str:
    return next((item.text for item in field.metadata if isinstance(item, Expected)), "anything")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default is PydanticUndefined:
        return "depends"
    if field.default is None:
        return "none"
    if field.default == EMPTY:
        return "`{}`"
    return f"`{json.dumps(field.default)}`"


def _quality_of_service() -> str:
    head = "#### Quality of service\n\nThe object `qos`. A policy that is left out is the server's choice.\n"
    return "\n".join([head, _table("qos", Qos)])


def _compact_messages() -> str:
    head = (
        "#### Compact messages\n\nThe object `compact` of `subscribe`. A `sensor_msgs/PointCloud2` arrives as"
        " a [compressed cloud](point-clouds.md); topics of other types are not affected. Servers without the"
        " option, or without the extra `clouds`, send whole messages.\n"
    )
    return "\n".join([head, _table("compact", Compact)])


def _summary(model: type[Op]) -> str:
    """The docstring's first paragraphs, before `Attributes:`."""
    text = inspect.getdoc(model) or ""
    return re.sub(r"``", "`", text.partition("Attributes:")[0].strip())


def _attributes(model: type[object]) -> dict[str, str]:
    """Return the fields' descriptions in the docstrings of a model and its bases, with lines joined."""
    found: dict[str, str] = {}
    for each in reversed(model.__mro__):
        last = ""
        for line in inspect.cleandoc(each.__doc__ or "").partition("Attributes:")[2].splitlines():
            start = re.match(r"    (\w+): (.*)", line)
            if start:
                last = start[1]
                found[last] = start[2]
            elif line.strip() and last:
                found[last] += f" {line.strip()}"
    return {name: _in_words_of_json(meaning) for name, meaning in found.items()}


def _in_words_of_json(meaning: str) -> str:
    """Replace None by "absent": in JSON, the member is left out."""
    text = re.sub(r"\bNone\b", "absent", meaning)
    return text[:1].upper() + text[1:]


def main() -> None:
    """Write the page, or compare it."""
    page = PAGE.read_text(encoding="utf-8")
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise SystemExit(f"{PAGE} has lost the marks between which the ops are listed")
    current = f"{before}{BEGIN}\n{render()}\n{END}{after}"
    if "--check" in sys.argv:
        if page != current:
            raise SystemExit(f"{PAGE.name} is not current: run python {Path(__file__).name}")
    else:
        PAGE.write_text(current, encoding="utf-8")


if __name__ == "__main__":
    main()
