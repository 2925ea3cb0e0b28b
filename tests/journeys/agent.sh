# docs/how-to/agents.md: an agent on the robot's own port, and what it may not do.
server rwt serve ws://127.0.0.1:9090 --demo --set gateways=http,mcp
cat > agent.py <<'PYTHON'
import anyio
from mcp.client import Client


async def main() -> None:
    async with Client("http://127.0.0.1:9090/mcp") as agent:
        tools = {tool.name: tool for tool in (await agent.list_tools()).tools}
        assert tools["read_topic"].output_schema and "publish" not in tools
        result = await agent.call_tool("read_topic", {"topic": "/battery_state"})
        print(result.structured_content["message"]["percentage"])
        refused = await agent.call_tool("publish", {"topic": "/cmd_vel", "message": {}})
        assert refused.is_error
        print(refused.content[0].text)
        async with agent.listen(resource_subscriptions=["robot://topics/odom"]) as events:
            print(await anext(events))


anyio.run(main)
PYTHON
python agent.py
fails rwt mcp --robot ws://127.0.0.1:1 --timeout 1
