# docs/how-to/webrtc.md: rosbridge over a data channel, from commands and a program; an offer that is no offer.
needs aiortc
server rwt serve --demo --webrtc ws://127.0.0.1:9090
rwt doctor --url webrtc+http://127.0.0.1:9090
rwt topic echo /odom --once --url webrtc+http://127.0.0.1:9090
rwt service call /add_two_ints '{a: 1, b: 2}' --url webrtc+http://127.0.0.1:9090
cat > drive.py <<'PYTHON'
import anyio

from rwt_client import connect


async def main():
    async with connect("webrtc+http://127.0.0.1:9090") as robot:
        print(await robot.call("/add_two_ints", {"a": 2, "b": 3}))


anyio.run(main)
PYTHON
python drive.py
curl -sS -d 'v=0' -H 'Content-Type: application/sdp' -w '%{http_code}\n' http://127.0.0.1:9090/webrtc | grep 400
