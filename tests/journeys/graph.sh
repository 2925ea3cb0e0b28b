# docs/how-to/client.md, docs/reference/graph.md: one program as a client and as the robot, and a closed node.
server rwt serve ws://127.0.0.1:9090 --demo
block docs/how-to/client.md 'async def program(robot: RobotApi)' > greeter.py
python greeter.py
cat > closed.py <<'PYTHON'
import anyio

from rwt import HandleClosed, MemoryGraph


async def main():
    async with MemoryGraph() as graph:
        node = graph.node("talker")
        publisher = node.advertise("/chatter", "std_msgs/String")
        node.close()
        try:
            publisher.publish({"data": "late"})
        except HandleClosed as error:
            print(error)
            return
    raise SystemExit("the message was lost without an error")


anyio.run(main)
PYTHON
python closed.py
