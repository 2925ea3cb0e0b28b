"""WebSocket (RFC 6455): frames, compression and both handshakes."""
