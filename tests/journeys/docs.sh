# README.md, docs/how-to/cookbook.md: the first program, and the recipes that a search leads to.
server rwt serve ws://127.0.0.1:9090 --demo
block README.md 'nearest wall' > first.py
python first.py
for words in camera.jpg tf.lookup /fibonacci; do
  block docs/how-to/cookbook.md "$words" > recipe.py
  python recipe.py
done
test -s camera.jpg
block docs/how-to/cookbook.md /api/services | sed 's/ROBOT/127.0.0.1/' > ask.sh
sh ask.sh
block docs/how-to/cookbook.md gate.rules.drive > robot.toml
block docs/how-to/cookbook.md auth.tokens.guest >> robot.toml
fails rwt serve --check --config robot.toml
sed -i "s/CHANGE-ME/$(python -c "import secrets; print(secrets.token_urlsafe(32))")/" robot.toml
rwt serve --check --config robot.toml
block docs/how-to/cookbook.md says_hello > test_hello.py
pytest -q test_hello.py
