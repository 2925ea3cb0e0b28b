"""The types of settings that several groups of them share."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field

MIB: Final = 1024 * 1024

Bytes = Annotated[int, Field(ge=1024)]
Count = Annotated[int, Field(ge=1)]
CountOrNone = Annotated[int, Field(ge=0)]
Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
SecondsOrNone = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Globs = tuple[str, ...]


class Table(BaseModel):
    """A group of settings: one table of the TOML file."""

    model_config = ConfigDict(frozen=True, extra="forbid")
