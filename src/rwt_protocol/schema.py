"""The whole protocol as one JSON Schema, made from the models."""

from __future__ import annotations

from typing import Final

from pydantic import JsonValue
from pydantic.json_schema import GenerateJsonSchema, models_json_schema

from rwt_protocol.ops import OPS, SPEC_OF, OpSpec
from rwt_protocol.profiles import COMPAT, Profile
from rwt_protocol.rawjson import RawJson

_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


class _Generator(GenerateJsonSchema):
    """Writes the default of a payload, which pydantic cannot."""

    def encode_default(self, dft: object) -> JsonValue:
        """A default value as JSON; a payload's is an empty object."""
        return {} if isinstance(dft, RawJson) else super().encode_default(dft)


def protocol_schema(profile: Profile = COMPAT) -> dict[str, JsonValue]:
    """One document that describes every message of `profile`.

    A message is one of the definitions under ``$defs``, told apart by ``op``; each says under ``x-direction``
    who sends it. Members that a definition does not list are allowed and ignored (ENV-01); null stands for an
    absent optional member, which the document leaves out.
    """
    models = [OPS[name].model for name in sorted(profile.ops)]
    schemas, document = models_json_schema(
        [(model, "validation") for model in models], schema_generator=_Generator
    )
    definitions: dict[str, JsonValue] = dict(document["$defs"])
    references: dict[str, JsonValue] = {}
    specs = {spec.model.__name__: spec for spec in SPEC_OF.values()}
    for (model, _), reference in schemas.items():
        spec = specs[model.__name__]
        definition = definitions[model.__name__]
        if isinstance(definition, dict):
            _finish(definition, spec, profile.without.get(spec.name, frozenset()))
        references[spec.name] = reference["$ref"]
    alternatives: list[JsonValue] = [{"$ref": reference} for reference in references.values()]
    return {
        "$schema": _DIALECT,
        "title": f"rosbridge v2, profile {profile.name}",
        "type": "object",
        "oneOf": alternatives,
        "discriminator": {"propertyName": "op", "mapping": references},
        "$defs": _used(definitions, references),
    }


def _finish(definition: dict[str, JsonValue], spec: OpSpec, without: frozenset[str]) -> None:
    """What the model's own schema does not say: who sends it, that `op` is needed, what the profile lacks."""
    definition["x-direction"] = spec.direction.value
    members = definition["properties"]
    required = definition.setdefault("required", [])
    if isinstance(members, dict) and isinstance(required, list):
        names: list[JsonValue] = [spec.name, *spec.aliases]
        members["op"] = {"enum": names} if spec.aliases else {"const": spec.name}
        required.insert(0, "op")
        for name in without:
            members.pop(name, None)


def _used(definitions: dict[str, JsonValue], references: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """The definitions of the ops, and those that they still refer to."""
    ops = {str(reference).rpartition("/")[2] for reference in references.values()}
    text = repr([definitions[name] for name in sorted(ops)])
    return {
        name: definition
        for name, definition in definitions.items()
        if name in ops or f"#/$defs/{name}'" in text
    }
