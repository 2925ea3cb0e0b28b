"""JSON Schema and AsyncAPI documents of the protocol, generated from the models.

``python -m rwt_protocol.schema FOLDER`` writes both for each version of the protocol.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pydantic import JsonValue
from pydantic.json_schema import models_json_schema

from rwt_protocol.ops import OPS, Direction, OpSpec
from rwt_protocol.profiles import COMPAT, PROFILES, Profile

_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def protocol_schema(profile: Profile = COMPAT) -> dict[str, JsonValue]:
    """Return one JSON Schema that describes every message of `profile`.

    Each message is a definition under ``$defs``, distinguished by ``op``; ``x-direction`` names its sender.
    Unlisted members are allowed and ignored (ENV-01). Null stands for an absent optional member, which the
    document omits.
    """
    definitions, references = _definitions(profile, "#/$defs/")
    alternatives: list[JsonValue] = [{"$ref": reference} for reference in references.values()]
    mapping: dict[str, JsonValue] = dict(references)
    return {
        "$schema": _DIALECT,
        "title": f"rosbridge v2, profile {profile.name}",
        "type": "object",
        "oneOf": alternatives,
        "discriminator": {"propertyName": "op", "mapping": mapping},
        "$defs": definitions,
    }


def protocol_asyncapi(profile: Profile = COMPAT, version: str = "2.0.0") -> dict[str, JsonValue]:
    """Return an AsyncAPI 3.0 document, from the server's point of view."""
    definitions, references = _definitions(profile, "#/components/schemas/")
    messages: dict[str, JsonValue] = {
        op: {"name": op, "payload": {"$ref": reference}} for op, reference in references.items()
    }
    return {
        "asyncapi": "3.0.0",
        "info": {"title": f"rosbridge v2, profile {profile.name}", "version": version},
        "defaultContentType": "application/json",
        "channels": {"connection": {"address": "/", "messages": messages}},
        "operations": {
            "receive": _operation("receive", profile, Direction.TO_SERVER),
            "send": _operation("send", profile, Direction.TO_CLIENT),
        },
        "components": {"schemas": definitions},
    }


def _operation(action: str, profile: Profile, direction: Direction) -> dict[str, JsonValue]:
    messages: list[JsonValue] = [
        {"$ref": f"#/channels/connection/messages/{op}"} for op in sorted(profile.arriving(direction))
    ]
    return {"action": action, "channel": {"$ref": "#/channels/connection"}, "messages": messages}


def _definitions(profile: Profile, where: str) -> tuple[dict[str, JsonValue], dict[str, str]]:
    """Return the schemas of the ops of `profile` and of what they refer to, and each op's reference."""
    specs = [OPS[op] for op in sorted(profile.ops)]
    _, document = models_json_schema(
        [(spec.model, "validation") for spec in specs],
        ref_template=where + "{model}",
    )
    definitions: dict[str, JsonValue] = dict(document["$defs"])
    for spec in specs:
        definition = definitions[spec.model.__name__]
        if isinstance(definition, dict):
            _finish(definition, spec, profile)
    used: dict[str, JsonValue] = {}
    wanted = [spec.model.__name__ for spec in specs]
    while wanted:
        name = wanted.pop()
        if name not in used:
            used[name] = definitions[name]
            text = repr(definitions[name])
            wanted += [other for other in definitions if f"{where}{other}'" in text]
    return dict(sorted(used.items())), {spec.name: where + spec.model.__name__ for spec in specs}


def _finish(definition: dict[str, JsonValue], spec: OpSpec, profile: Profile) -> None:
    """Add to a schema what the model's own lacks: sender, required `op`, and the members without."""
    definition["x-direction"] = profile.direction(spec.name).value
    members = definition["properties"]
    required = definition.setdefault("required", [])
    if isinstance(members, dict) and isinstance(required, list):
        names: list[JsonValue] = [spec.name, *spec.aliases]
        members["op"] = {"enum": names} if spec.aliases else {"const": spec.name}
        required.insert(0, "op")
        for name in profile.without.get(spec.name, ()):
            members.pop(name, None)


def write_documents(folder: Path) -> Sequence[Path]:
    """Write each profile as ``rosbridge-NAME.schema.json`` and ``rosbridge-NAME.asyncapi.json``.

    Raises:
        OSError: the folder is not writable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for profile in PROFILES.values():
        documents = {"schema": protocol_schema(profile), "asyncapi": protocol_asyncapi(profile)}
        for kind, document in documents.items():
            file = folder / f"rosbridge-{profile.name}.{kind}.json"
            file.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
            written.append(file)
    return written


def main(arguments: Sequence[str]) -> int:
    """Run the command: write the documents to the given folder and print their names."""
    if len(arguments) != 1 or arguments[0].startswith("-"):
        sys.stderr.write("usage: python -m rwt_protocol.schema FOLDER\n")
        return 2
    try:
        written = write_documents(Path(arguments[0]))
    except OSError as error:
        sys.stderr.write(f"cannot write to {arguments[0]}: {error.strerror}\n")
        return 1
    sys.stdout.writelines(f"{file}\n" for file in written)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
