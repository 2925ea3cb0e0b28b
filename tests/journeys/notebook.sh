# docs/how-to/client.md, notebooks: an image, a map and a plot, as Jupyter displays them.
server rwt serve ws://127.0.0.1:9090 --demo
cat > cells.py <<'PYTHON'
import os

from rwt_client.blocking import connect
from rwt_client.notebook import show

with connect(os.environ["RWT_URL"]) as robot:
    for words in (["/camera/image_raw/compressed"], ["/map"], ["/odom", "twist.twist.linear.x"]):
        print(words, show(robot, *words).render()[0])
    try:
        show(robot, "/odom")
    except ValueError as error:
        print(error)
PYTHON
python cells.py
