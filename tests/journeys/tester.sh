# docs/how-to/test-an-app.md: a scripted robot for pytest, for vitest, and a test that fails with its reason.
block docs/how-to/test-an-app.md test_the_app_greets > test_greet.py
pytest -q test_greet.py
sed 's/Hello {name}/Hallo {name}/' test_greet.py > test_wrong.py
fails pytest -q test_wrong.py > failure
grep "data is 'Hallo Ada', not 'Hello Ada'" failure
block docs/how-to/test-an-app.md 'name = "lab"' > robot.toml
server rwt serve --script robot.toml ws://127.0.0.1:9090
rwt service call /add '{a: 2, b: 3}'
fails rwt service call /add '{a: 13}'
needs npm
npm install --save-dev vitest roslib
block docs/how-to/test-an-app.md 'provide("robotUrl"' > robot-server.mjs
block docs/how-to/test-an-app.md globalSetup: > vitest.config.mjs
block docs/how-to/test-an-app.md 'from "vitest"' > app.test.mjs
npx vitest run
