"""Settings of WebRTC."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, SecretStr, model_validator

from rwt.access.settings import Count, Seconds, Table


class WebRtcSettings(Table):
    """WebRTC through the port of `ws://` and `wss://` listeners. Needs the extra `webrtc`, and asyncio."""

    enabled: Annotated[
        bool, Field(description="whether offers are taken at `/webrtc`: rosbridge over data channels")
    ] = False
    servers: Annotated[
        tuple[str, ...],
        Field(
            max_length=8,
            description="servers that help to find a path, like `stun:stun.example.org` and"
            " `turn:turn.example.org:3478?transport=udp`; none for peers in one network",
        ),
    ] = ()
    username: Annotated[str, Field(description="name that the TURN servers know")] = ""
    credential: Annotated[
        SecretStr | None, Field(description="its password, which clients are told with each answer")
    ] = None
    credential_command: Annotated[
        tuple[str, ...],
        Field(
            description="program and arguments that print a TURN credential for a while, as JSON with"
            " `username`, `password`, `ttl` in seconds and perhaps `uris`"
        ),
    ] = ()
    credential_url: Annotated[
        str | None, Field(pattern=r"^https?://", description="URL that answers such a credential")
    ] = None
    peers: Annotated[Count, Field(description="peer connections that are open at a time")] = 32
    handshakes: Annotated[Count, Field(description="of them, those that have not found their path yet")] = 8
    channels: Annotated[Count, Field(description="data channels of a peer, each of which is a client")] = 16
    candidates: Annotated[Count, Field(description="addresses of a peer that are tried")] = 64
    connect_seconds: Annotated[Seconds, Field(description="from the offer until a path has to be found")] = (
        15.0
    )

    @model_validator(mode="after")
    def _one_credential(self) -> WebRtcSettings:
        if sum(map(bool, (self.credential, self.credential_command, self.credential_url))) > 1:
            raise ValueError(
                "expected at most one of `credential`, `credential_command` and `credential_url`"
            )
        return self
