# docs/how-to/own-transport.md, docs/how-to/interfaces.md: rosbridge over a serial line, and messages as bytes.
block docs/how-to/interfaces.md 'Payload.from_json(plant' > plant.py
python plant.py
needs socat
socat pty,raw,echo=0,link=robot pty,raw,echo=0,link=laptop & echo $! > socat.pid
block docs/how-to/own-transport.md 'class Client' > serial_server.py
block docs/how-to/own-transport.md 'Direction.TO_CLIENT' > serial_client.py
until test -e laptop; do sleep 0.1; done
python serial_server.py robot & echo $! > serial.pid
python serial_client.py laptop > answers
grep 'heard: over a wire' answers
grep 'sum: 3' answers
