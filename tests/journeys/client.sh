# docs/how-to/client.md: a program of a few lines, and the errors that it meets.
server rwt serve ws://127.0.0.1:9090 --demo
cat > ask.py <<'PYTHON'
import os
import sys

from rwt import HandleClosed, WrongType
from rwt_client.blocking import connect

with connect(os.environ["RWT_URL"]) as robot:
    print(robot.call("/add_two_ints", {"a": 1, "b": 2}).sum)
    try:
        robot.call("/add_two_ints", {}, "std_srvs/Trigger")
    except WrongType as error:
        print(error)
    try:
        robot.subscribe("/odom", "nav_msgs/Odometry")
    except TypeError as error:
        print(error)
    publisher = robot.advertise("/chatter", "std_msgs/String")
    publisher.close()
    try:
        publisher.publish({"data": "late"})
    except HandleClosed as error:
        sys.exit(print(error))
sys.exit("nothing was wrong")
PYTHON
python ask.py
