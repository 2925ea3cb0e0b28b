"""What an operator can set, with its defaults; read from a TOML file."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError


class SettingsError(ValueError):
    """A setting that cannot be used; the text says which, where it stands and what is expected."""


class Settings(BaseModel):
    """Everything a server can be told.

    Attributes:
        listen: URLs to serve on; port 0 picks a free one.
        distro: whose names and messages the robot speaks.
        interfaces: folders of `.msg`, `.srv` and `.action` files.
        demo: whether the demo robot takes part.
        profile: protocol text to follow; `compat` takes what any client sends.
        max_message_size: largest message taken from a client, bytes.
        default_call_service_timeout: seconds a service call may take when its caller says nothing (SRV-10);
            0 waits for ever.
        unregister_timeout: seconds a topic outlives its last rosbridge publisher (UNA-04).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    listen: tuple[str, ...] = ("ws://127.0.0.1:9090",)
    distro: Literal["jazzy", "noetic"] = "jazzy"
    interfaces: tuple[Path, ...] = ()
    demo: bool = False
    profile: Literal["compat", "ros1", "ros2-2024", "2.0.0"] = "compat"
    max_message_size: Annotated[int, Field(ge=1024)] = 64 * 1024 * 1024
    default_call_service_timeout: Annotated[float, Field(ge=0)] = 5.0
    unregister_timeout: Annotated[float, Field(ge=0)] = 10.0


def read_settings(path: Path) -> Settings:
    """Read a TOML file.

    Raises:
        SettingsError: the file cannot be read, is not TOML, or holds an unknown key or a wrong value.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not TOML: {error}") from error
    try:
        return Settings.model_validate(values)
    except ValidationError as error:
        raise SettingsError(f"{path}: {_first_fault(error)}") from error


def _first_fault(error: ValidationError) -> str:
    """The first thing that is wrong, in one line."""
    fault = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in fault["loc"])
    if fault["type"] == "extra_forbidden":
        near = difflib.get_close_matches(key, Settings.model_fields, n=1, cutoff=0.5)
        known = f"did you mean `{near[0]}`?" if near else f"known are {', '.join(Settings.model_fields)}"
        return f"unknown setting `{key}`; {known}"
    return f"`{key}`: {fault['msg']}, got {fault['input']!r}"
