"""Settings of WebRTC: the model alone."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, SecretStr, model_validator

from rwt.access.settings import Count, Seconds, Table


class WebRtcSettings(Table):
    """WebRTC through the port of `ws://` and `wss://` listeners. Needs the extra `webrtc`, and asyncio."""

    enabled: bool = Field(False, description="accept offers at `/webrtc`: rosbridge over data channels")
    servers: tuple[str, ...] = Field(
        (),
        max_length=8,
        description="STUN and TURN servers, such as `stun:stun.example.org` and"
        " `turn:turn.example.org:3478?transport=udp`; none for peers in one network",
    )
    username: str = Field("", description="user name for the TURN servers")
    credential: SecretStr | None = Field(
        None, description="password for the TURN servers, sent to clients with each answer"
    )
    credential_command: tuple[str, ...] = Field(
        (),
        description="command that prints a temporary TURN credential as JSON: `username`, `password`, `ttl`"
        " in seconds, and optionally `uris`",
    )
    credential_url: str | None = Field(
        None, pattern=r"^https?://", description="URL that returns such a credential"
    )
    addresses: Literal["auto", "all", "relay"] = Field(
        "auto",
        description="addresses that peers are told and that are tried: `auto`, private ones only for"
        " clients with private addresses; `all`, private ones for every client, such as one in the robot's"
        " network that comes through a hub; `relay`, only those of a TURN server",
    )
    peers: Count = Field(32, description="open peer connections, which clients share")
    handshakes: Count = Field(
        8,
        description="peer connections that are still connecting, which clients share; offers wait up to 5 s"
        " for one",
    )
    channels: Count = Field(16, description="data channels per peer; each is a client")
    candidates: Count = Field(64, description="candidate addresses per peer")
    connect_seconds: Seconds = Field(
        15.0, description="seconds from the offer until the connection must be established"
    )

    @model_validator(mode="after")
    def _one_credential(self) -> WebRtcSettings:
        if sum(map(bool, (self.credential, self.credential_command, self.credential_url))) > 1:
            raise ValueError(
                "expected at most one of `credential`, `credential_command` and `credential_url`"
            )
        if self.addresses == "relay" and not self.servers and not self.credential_command:
            raise ValueError('`addresses = "relay"` needs a TURN server in `servers`')
        return self
