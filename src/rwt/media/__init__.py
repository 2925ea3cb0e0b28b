"""Image, video and audio encoders, shared by nodes, WebRTC and MCP."""
