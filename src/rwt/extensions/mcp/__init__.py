"""Gateway for agents: language models use the robot through tools, resources and prompts of MCP.

The protocol is implemented by its official SDK (extra `mcp`), imported when a gateway is created; listing the
tools does not need it.
"""
