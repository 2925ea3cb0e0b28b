"""The gateway for agents: language models use the robot through the tools, resources and prompts of MCP.

The Model Context Protocol itself is spoken by its official SDK, which is the extra `mcp`. Nothing imports it
before a gateway is made, so the tools can be listed and described without it.
"""
