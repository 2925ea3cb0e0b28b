# docs/how-to/foxglove.md: Foxglove's protocol on the same port, with the program of the page; and for a role of one's own.
server rwt serve --demo ws://127.0.0.1:9090
block docs/how-to/foxglove.md foxglove.websocket.v1 > viewer.py
python viewer.py
rwt bag record -o drive.mcap --max-seconds 2 /odom /scan
kill "$(cat rwt.pid)"
ended
server rwt bag play drive.mcap ws://127.0.0.1:9090 --loop
python viewer.py
