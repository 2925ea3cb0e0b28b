"""Settings of WebRTC."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, SecretStr, model_validator

from rwt.access.settings import Count, Seconds, Table


class WebRtcSettings(Table):
    """WebRTC through the port of `ws://` and `wss://` listeners. Needs the extra `webrtc`, and asyncio."""

    enabled: Annotated[
        bool, Field(description="accept offers at `/webrtc`: rosbridge over data channels")
    ] = False
    servers: Annotated[
        tuple[str, ...],
        Field(
            max_length=8,
            description="STUN and TURN servers, such as `stun:stun.example.org` and"
            " `turn:turn.example.org:3478?transport=udp`; none for peers in one network",
        ),
    ] = ()
    username: Annotated[str, Field(description="user name for the TURN servers")] = ""
    credential: Annotated[
        SecretStr | None, Field(description="password for the TURN servers, sent to clients with each answer")
    ] = None
    credential_command: Annotated[
        tuple[str, ...],
        Field(
            description="command that prints a temporary TURN credential as JSON: `username`, `password`,"
            " `ttl` in seconds, and optionally `uris`"
        ),
    ] = ()
    credential_url: Annotated[
        str | None, Field(pattern=r"^https?://", description="URL that returns such a credential")
    ] = None
    addresses: Annotated[
        Literal["auto", "all", "relay"],
        Field(
            description="addresses that peers are told and that are tried: `auto`, private ones only for"
            " clients with private addresses; `all`, private ones for every client, such as one in the"
            " robot's network that comes through a hub; `relay`, only those of a TURN server"
        ),
    ] = "auto"
    peers: Annotated[Count, Field(description="open peer connections")] = 32
    handshakes: Annotated[
        Count, Field(description="peer connections that are still connecting; offers wait up to 5 s for one")
    ] = 8
    channels: Annotated[Count, Field(description="data channels per peer; each is a client")] = 16
    candidates: Annotated[Count, Field(description="candidate addresses per peer")] = 64
    connect_seconds: Annotated[
        Seconds, Field(description="seconds from the offer until the connection must be established")
    ] = 15.0

    @model_validator(mode="after")
    def _one_credential(self) -> WebRtcSettings:
        if sum(map(bool, (self.credential, self.credential_command, self.credential_url))) > 1:
            raise ValueError(
                "expected at most one of `credential`, `credential_command` and `credential_url`"
            )
        if self.addresses == "relay" and not self.servers and not self.credential_command:
            raise ValueError('`addresses = "relay"` needs a TURN server in `servers`')
        return self
