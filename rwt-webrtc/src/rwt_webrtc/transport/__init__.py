"""WebRTC data channels as one more transport: peer connections, their signalling over HTTP, and both ends."""
