# docs/how-to/interfaces.md: message types of one's own, in a robot, for editors, and with a mistake.
mkdir -p interfaces/garden_msgs/msg interfaces/garden_msgs/srv
block docs/how-to/interfaces.md 'string DRY=dry' > interfaces/garden_msgs/msg/Plant.msg
block docs/how-to/interfaces.md 'float32 litres' > interfaces/garden_msgs/srv/Water.srv
block docs/how-to/interfaces.md 'interfaces=["interfaces"]' > garden.py
server python garden.py
fails rwt interface show garden_msgs/msg/Plant
rwt interface show --live garden_msgs/msg/Plant
rwt topic echo /plants --once
rwt service call /water '{name: fern, litres: 0.5}'
fails rwt service call /water '{name: fern, liters: 0.5}'
rwt interface generate --lang python --interfaces interfaces/ --out messages.py garden_msgs/msg/Plant
rwt interface generate --lang typescript --interfaces interfaces/ --out messages.ts garden_msgs/msg/Plant
python -c 'import messages'
echo 'float23 wrong' >> interfaces/garden_msgs/msg/Plant.msg
fails rwt serve --interfaces interfaces/ ws://127.0.0.1:0 2> mistake
grep 'Plant.msg' mistake
grep 'float32' mistake
