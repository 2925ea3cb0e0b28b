# README.md, docs/how-to/own-page.md: roslib in Node, the dashboard, and what a page needs of the robot.
server rwt serve ws://127.0.0.1:9090 --demo
needs npm
npm install roslib
block README.md 'from "roslib"' > drive.mjs
timeout 20 node drive.mjs > places & echo $! > drive.pid
logged 'x:' places
rwt topic echo /cmd_vel --once
curl -fsS http://127.0.0.1:9090/web/widgets.js -o widgets.js
curl -fsS -o camera.jpg 'http://127.0.0.1:9090/snapshot?topic=/camera/image_raw'
curl -fsS http://127.0.0.1:9090/ | grep '<title>'
