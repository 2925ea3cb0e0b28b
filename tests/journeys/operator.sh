# docs/how-to/deploy.md, docs/how-to/secure.md, docs/how-to/client.md: check, serve, reload, stop.
cat > rwt.toml <<'TOML'
listen = ["ws://127.0.0.1:9090"]
demo = true

[auth]
default_role = "viewer"

[roles.operator]
publish = ["/cmd_vel"]
call = ["*"]
subscribe = ["*"]

[auth.tokens.operator]
token = "b1DNzdIYB4L6B5mMTp0DzYRkUgXWP0uO3eG1QSjS8ho"
role = "operator"
TOML
rwt serve --check --config rwt.toml
rwt config show --config rwt.toml
server rwt serve --config rwt.toml --log-format logfmt
fails rwt service call /add_two_ints '{a: 1, b: 2}'
RWT_TOKEN=b1DNzdIYB4L6B5mMTp0DzYRkUgXWP0uO3eG1QSjS8ho rwt service call /add_two_ints '{a: 1, b: 2}'
RWT_TOKEN=b1DNzdIYB4L6B5mMTp0DzYRkUgXWP0uO3eG1QSjS8ho rwt doctor
cat > ask.py <<'PYTHON'
import os

from rwt_client.blocking import connect

headers = {"Authorization": f"Bearer {os.environ['RWT_TOKEN']}"}
with connect(os.environ["RWT_URL"], headers=headers) as robot:
    print(robot.call("/add_two_ints", {"a": 1, "b": 2}).sum)
PYTHON
RWT_TOKEN=b1DNzdIYB4L6B5mMTp0DzYRkUgXWP0uO3eG1QSjS8ho python ask.py
sed -i 's/"\*"/"\/rosapi\/*"/' rwt.toml
kill -HUP "$(cat rwt.pid)"
logged 'read again'
RWT_TOKEN=b1DNzdIYB4L6B5mMTp0DzYRkUgXWP0uO3eG1QSjS8ho fails rwt service call /add_two_ints '{a: 1, b: 2}'
