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

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from rwt_protocol.error_text import Expected
from rwt_protocol.ops import (
    OPS,
    ActionResult,
    Advertise,
    Auth,
    Direction,
    Fragment,
    Op,
    OpSpec,
    Png,
    Publish,
    Qos,
    ServiceResponse,
)
from rwt_protocol.ops.base import ReplyTo
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

#: What a field means where the model's own docstring does not say it: by op and field, or by field alone.
MEANINGS: dict[str | tuple[str, str], str] = {
    "id": "The sender's own mark, repeated unchanged in what answers this message (ENV-02). null: none.",
    "topic": "Name of the topic. `chatter` and `/chatter` are the same topic.",
    "action": "Name of the action.",
    "latch": "Keep the last message for whoever subscribes late.",
    "queue_size": "Accepted, and without effect: a topic in memory has no queue to a network.",
    ("advertise", "type"): "Type of the topic's messages, `std_msgs/String` or `std_msgs/msg/String`.",
    ("advertise", "qos"): "Quality of service, see [below](#quality-of-service); wins over `latch`.",
    "fragment_size": "Split what is longer than so many characters (FRG-20); absent and 0: do not.",
    (
        "subscribe",
        "compression",
    ): "`none`, `png`, `cbor` or `cbor-raw` ([encodings](encodings.md), SUB-08, SUB-10).",
    ("subscribe", "qos"): "Checked, and without effect: a subscriber gets what the publishers offer.",
    (
        "action_result",
        "status",
    ): "4 succeeded, 5 canceled, 6 aborted, 0 not run. Absent: 4, or 6 if `result` is false.",
    ("publish", "type"): "Type of the topic, used when nobody has advertised it.",
    ("publish", "msg"): "The message. Missing fields get their defaults, see [messages](#messages-in-json).",
    ("publish", "latch"): "As on `advertise`; has an effect on the first message of a topic not advertised.",
    ("service_response", "service"): "Name of the service.",
    ("advertise_service", "service"): "Name of the service.",
    ("unadvertise_service", "service"): "Name of the service.",
    ("advertise_service", "type"): "Type of the service, for example `std_srvs/Trigger`.",
    ("advertise_action", "type"): "Type of the action, for example `example_interfaces/Fibonacci`.",
    ("send_action_goal", "action_type"): "Type of the action; the server goes by what the action has.",
    ("cancel_action_goal", "id"): "The `id` with which the goal was sent.",
    ("action_feedback", "values"): "The feedback.",
    ("status", "level"): "Severity.",
    ("set_level", "level"): "The least severity that the client wants to hear of; `none` for nothing.",
    ("status", "msg"): "What happened, for people.",
    ("fragment", "id"): "The same for all pieces of one message.",
    ("fragment", "data"): "The piece.",
    ("fragment", "num"): "Number of the piece, from 0.",
    ("fragment", "total"): "How many pieces there are.",
    ("png", "data"): "Base64 of the image.",
    ("auth", "mac"): "The message authentication code.",
    ("auth", "client"): "The client's address, as it says.",
    ("auth", "dest"): "The server's address, as the client says.",
    ("auth", "rand"): "A random string.",
    ("auth", "t"): "When it was made, seconds since 1970.",
    ("auth", "level"): "The client's level of access, as it says.",
    ("auth", "end"): "When it expires, seconds since 1970.",
    ("qos", "history"): "Which messages are kept.",
    ("qos", "reliability"): "Whether a message may be lost on the way.",
    ("qos", "durability"): "`transient_local` keeps messages for whoever subscribes late.",
}

#: Where the docstring speaks to readers of the code.
SUMMARIES: dict[type[Op], str] = {
    Publish: "One message on a topic (PUB-01).",
    Advertise: "The sender will publish on a topic (ADV-01).",
    Fragment: "One piece of the text of another message (FRG-01).",
    Png: "A whole message as the pixels of a PNG image, in base64 (PNG-01).",
    Auth: "Credentials as rosauth computes them (AUT-02). Not there yet: the answer is a warning.",
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
    parts.append(_quality_of_service())
    return "\n".join(parts)


def _op(spec: OpSpec) -> str:
    lines = [f"#### {spec.name}\n", f"{_summary(spec.model)}\n", f"{_facts(spec)}\n"]
    return "\n".join([*lines, _table(spec.name, spec.model.model_fields, _attributes(spec.model))])


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


def _table(op: str, fields: dict[str, FieldInfo], described: dict[str, str]) -> str:
    rows = ["| field | holds | default | meaning |", "|---|---|---|---|"]
    for name, field in fields.items():
        if name != "op":
            meaning = _meaning(op, name, described)
            rows.append(f"| `{name}` | {_holds(field)} | {_default(field)} | {meaning} |")
    return "\n".join(rows) + "\n"


def _meaning(op: str, field: str, described: dict[str, str]) -> str:
    meaning = MEANINGS.get((op, field)) or MEANINGS.get(field) or described.get(field)
    if meaning is None:
        raise SystemExit(f"{op}.{field} has no description: add one to its model or to MEANINGS")
    return meaning


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
    return "\n".join([head, _table("qos", Qos.model_fields, _attributes(Qos))])


def _summary(model: type[Op]) -> str:
    """The docstring's first paragraphs, before `Attributes:`."""
    text = inspect.getdoc(model) or ""
    return SUMMARIES.get(model, re.sub(r"``", "`", text.partition("Attributes:")[0].strip()))


def _attributes(model: type[object]) -> dict[str, str]:
    """What the docstring says of each field; continued lines are joined."""
    text = (inspect.getdoc(model) or "").partition("Attributes:")[2]
    found: dict[str, str] = {}
    last = ""
    for line in text.splitlines():
        start = re.match(r"    (\w+): (.*)", line)
        if start:
            last = start[1]
            found[last] = start[2]
        elif line.strip() and last:
            found[last] += f" {line.strip()}"
    return {name: _in_words_of_json(meaning) for name, meaning in found.items()}


def _in_words_of_json(meaning: str) -> str:
    """What the docstring calls None is a member that is absent."""
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
