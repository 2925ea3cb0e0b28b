"""OpenAPI 3.1 description of the robot as one reader may use it, with the JSON Schema of each type."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from rwt.access.graph_view import GraphView
from rwt.extensions.http import actions, calls, parameters, topics
from rwt.extensions.http.problems import CONTENT_TYPE as PROBLEM
from rwt.extensions.http.representations import CBOR, EVENTS, JSON
from rwt.extensions.http.requests import MAX_WAIT_SECONDS
from rwt.extensions.http.schemas import Schema, Schemas
from rwt.observability.build import version
from rwt_interfaces.structs import ActionType, MessageType, ServiceType

_NOT_IN_ID: Final = re.compile(r"[^A-Za-z0-9_]+")

_PROBLEMS: Final[Schema] = {
    "4XX": {"$ref": "#/components/responses/Problem"},
    "5XX": {"$ref": "#/components/responses/Problem"},
}
_TEXT: Final[Schema] = {"type": "string"}
_NAME_AND_TYPE: Final[Schema] = {
    "type": "object",
    "properties": {"name": _TEXT, "type": {"type": ["string", "null"]}},
    "required": ["name", "type"],
}
_ANY_VALUE: Final[Schema] = {
    "description": "a boolean, a number, a string, or an array of one of these; on ROS 1 anything"
}

_EVENT_STREAM: Final[Schema] = {
    "type": "string",
    "description": "server-sent events (HTML standard, section 9.2), whose `data` is JSON; of events without"
    " a name, it is that of the other representations",
}

_WAITS: Final[Schema] = {
    "202": {
        "description": "it waits for human approval; GET of `Location` returns its state, then the response",
        "headers": {"Location": {"description": "of the call", "schema": _TEXT}},
    }
}
"""Response to a request that waits for approval. With its content, generated clients would type each
answer as one of two.
"""

_SHARED: Final[Schema] = {
    "responses": {
        "Problem": {
            "description": "what is wrong, where, and what to do instead (RFC 9457)",
            "content": {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}},
        }
    },
    "securitySchemes": {
        "bearer": {"type": "http", "scheme": "bearer"},
        "token": {"type": "apiKey", "in": "query", "name": "token"},
    },
}
_PROBLEM_SCHEMA: Final[Schema] = {
    "type": "object",
    "properties": {
        "type": {"type": "string", "format": "uri-reference"},
        "title": _TEXT,
        "status": {"type": "integer"},
        "detail": _TEXT,
        "instead": _TEXT,
        "instance": {"type": "string", "format": "uri-reference"},
        "where": _TEXT,
    },
    "required": ["type", "title", "status", "detail", "instead"],
}


def describe(reader: GraphView, prefix: str, title: str) -> Schema:
    """Return the document for one reader, with the operations that its role allows below a path prefix."""
    description = _Description(reader)
    return {
        "openapi": "3.1.0",
        "info": {"title": title, "version": version()},
        "servers": [{"url": prefix or "/"}],
        "security": [{}, {"bearer": []}, {"token": []}],
        "paths": description.paths(),
        "components": {
            **_SHARED,
            "schemas": {
                "Problem": _PROBLEM_SCHEMA,
                "NameAndType": _NAME_AND_TYPE,
                "ParameterValue": _ANY_VALUE,
                "EventStream": _EVENT_STREAM,
                **dict(sorted(description.schemas.found.items())),
            },
        },
    }


class _Description:
    """Builder of the paths and schemas of one document."""

    def __init__(self, reader: GraphView) -> None:
        self._reader = reader
        self._role = reader.role
        self._longest = MAX_WAIT_SECONDS
        self._ids: set[str] = set()
        self.schemas = Schemas()

    def paths(self) -> Schema:
        paths: Schema = {
            "/version": {
                "get": self._operation("get_version", "server", "What runs here", _ok({"type": "object"}))
            }
        }
        for kind in ("topics", "services", "actions"):
            listed = {"type": "array", "items": _named("NameAndType")}
            paths[f"/api/{kind}"] = {
                "get": self._operation(f"list_{kind}", kind, f"The {kind} that are shown", _ok(listed))
            }
        for topic in self._reader.topics():
            if topic.type is not None:
                paths[topics.PATH + topic.name[1:]] = self._topic(topic.name, topic.type)
        for service in self._reader.services():
            paths[calls.PATH + service.name[1:]] = self._service(service.name, service.type)
        for action in self._reader.actions():
            paths.update(self._action(action.name, action.type))
        return {path: item for path, item in (paths | self._parameters()).items() if item}

    def _operation(
        self,
        id: str,
        tag: str,
        summary: str,
        responses: Mapping[str, object],
        *,
        query: Iterable[Schema] = (),
        body: Mapping[str, object] | None = None,
        required: bool = False,
    ) -> Schema:
        operation: Schema = {
            "operationId": self._unused(id),
            "tags": [tag],
            "summary": summary,
            "responses": {**responses, **_PROBLEMS},
        }
        if parameters := list(query):
            operation["parameters"] = parameters
        if body is not None:
            operation["requestBody"] = {"content": _written(body), "required": required}
        return operation

    def _unused(self, id: str) -> str:
        """Return an unused operation id: `/a_b` and `/a/b` would share one."""
        wanted = found = _NOT_IN_ID.sub("_", id)
        count = 1
        while found in self._ids:
            count += 1
            found = f"{wanted}_{count}"
        self._ids.add(found)
        return found

    def _seconds(self, name: str, what: str) -> Schema:
        schema = {"type": "number", "minimum": 0, "maximum": self._longest}
        return {"name": name, "in": "query", "description": what, "schema": schema}

    def _topic(self, name: str, type: MessageType) -> Schema:
        item: Schema = {}
        if self._role.allows("subscribe", name):
            item["get"] = self._operation(
                f"get{name}",
                "topics",
                f"The message of {name} that is kept, or the next one",
                _ok(self.schemas.reference(type), has_events=True),
                query=(
                    self._seconds("wait", "wait so many seconds for the next message"),
                    _query("throttle", {"type": "number", "minimum": 0, "maximum": topics.MAX_THROTTLE},
                           "of events: seconds between two at least"),
                    _query("queue", {"type": "integer", "minimum": 1, "maximum": topics.MAX_EVENTS},
                           "of events: how many may wait for a slow reader"),
                ),
            )  # fmt: skip
        if self._role.allows("publish", name):
            item["post"] = self._operation(
                f"publish{name}",
                "topics",
                f"Publish a message on {name}",
                {"204": {"description": "it was published"}},
                query=(_query("latch", {"type": "boolean"}, "keep it for late readers"),),
                body=self.schemas.reference(type, incoming=True),
            )
        return item

    def _service(self, name: str, type: ServiceType) -> Schema:
        item: Schema = {
            "get": self._operation(
                f"describe{name}", "services", f"The type of {name}", _ok(_named("NameAndType"))
            )
        }
        if self._reader.may_call(name):
            item["post"] = self._operation(
                f"call{name}",
                "services",
                f"Call {name}",
                {**_ok(self.schemas.reference(type.response)), **_WAITS},
                query=(self._seconds("timeout", "wait so many seconds for the answer"),),
                body=self.schemas.reference(type.request, incoming=True),
            )
        return item

    def _action(self, name: str, type: ActionType) -> Schema:
        path = actions.PATH + name[1:]
        named = _ok(_named("NameAndType"))
        found: Schema = {
            path: {"get": self._operation(f"describe{name}", "actions", f"The type of {name}", named)}
        }
        if not self._role.allows("goals", name):
            return found
        goal = self._goal(type)
        location = {"Location": {"description": "of the goal", "schema": _TEXT}}
        created = {
            "201": {"description": "the goal was sent", "headers": location, "content": _written(goal)}
        }
        found[f"{path}/goals"] = {
            "get": self._operation(
                f"list_goals{name}", "actions", f"Goals of this client for {name}",
                _ok({"type": "array", "items": goal}),
            ),
            "post": self._operation(
                f"send_goal{name}", "actions", f"Send a goal to {name}", created,
                body=self.schemas.reference(type.goal, incoming=True),
            )
        }  # fmt: skip
        canceled = {
            "202": {"description": "it was asked to end", "content": _written(goal)},
            "204": {"description": "it had ended, and is forgotten"},
        }
        goal_id = {
            "name": "goal_id", "in": "path", "required": True,
            "schema": {"type": "string", "pattern": "^[0-9a-f]{32}$"},
        }  # fmt: skip
        found[f"{path}/goals/{{goal_id}}"] = {
            "parameters": [goal_id],
            "get": self._operation(
                f"get_goal{name}", "actions", f"A goal of {name}", _ok(goal, has_events=True)
            ),
            "delete": self._operation(f"cancel_goal{name}", "actions", f"Cancel a goal of {name}", canceled),
        }
        return found

    def _goal(self, type: ActionType) -> Schema:
        name = f"{type.name.replace('/', '.')}.Goal"
        if name not in self.schemas.found:
            properties: Schema = {
                "id": _TEXT,
                "action": _TEXT,
                "state": {"type": "string", "enum": list(actions.STATES)},
                "feedback": {"anyOf": [self.schemas.reference(type.feedback), {"type": "null"}]},
                "result": {"anyOf": [self.schemas.reference(type.result), {"type": "null"}]},
                "reason": _TEXT,
            }
            self.schemas.found[name] = {
                "type": "object", "properties": properties, "required": list(properties)
            }  # fmt: skip
        return {"$ref": f"#/components/schemas/{name}"}

    def _parameters(self) -> Schema:
        names = _ok({"type": "array", "items": _TEXT})
        value = _named("ParameterValue")
        name = {
            "name": "name", "in": "path", "required": True, "schema": _TEXT,
            "description": "`node:name` on ROS 2, `name` on ROS 1; slashes in it are written as %2F",
        }  # fmt: skip
        item: Schema = {
            "parameters": [name],
            "get": self._operation("get_parameter", "parameters", "The value of a parameter", _ok(value)),
        }
        if self._role.unrestricted or self._role.globs["set_param"]:
            changed = {"204": {"description": "it was set"}, **_WAITS}
            item["put"] = self._operation(
                "set_parameter", "parameters", "Set a parameter", changed, body=value, required=True
            )
            removed = {"204": {"description": "it was removed"}, **_WAITS}
            item["delete"] = self._operation("delete_parameter", "parameters", "Remove a parameter", removed)
        listed = self._operation("list_parameters", "parameters", "The parameters that are shown", names)
        return {parameters.PATH.rstrip("/"): {"get": listed}, parameters.PATH + "{name}": item}


def _named(name: str) -> Schema:
    return {"$ref": f"#/components/schemas/{name}"}


def _query(name: str, schema: Mapping[str, object], description: str) -> Schema:
    return {"name": name, "in": "query", "description": description, "schema": schema}


def _written(schema: Mapping[str, object]) -> dict[str, Schema]:
    return {JSON: {"schema": schema}, CBOR: {"schema": schema}}


def _ok(schema: Mapping[str, object], *, has_events: bool = False) -> Schema:
    events: Schema = {EVENTS: {"schema": _named("EventStream")}} if has_events else {}
    return {"200": {"description": "as asked for", "content": {**_written(schema), **events}}}
