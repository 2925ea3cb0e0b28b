# docs/how-to/conformance.md: grade a server and a client library, and keep known failures.
server rwt serve ws://127.0.0.1:9090
rosbridge-conformance ws://127.0.0.1:9090 --run 'services/*' --run 'status/*' --html report.html
rosbridge-conformance ws://127.0.0.1:9090 --target rwt-jazzy --run 'publish/*' --json before.json
rosbridge-conformance diff before.json before.json
echo '[expected_failures]' > known.toml
echo '"services/no-such-case" = "a typing error"' >> known.toml
fails rosbridge-conformance ws://127.0.0.1:9090 --expect known.toml
fails rosbridge-conformance ws://127.0.0.1:1 --run 'services/*'
needs roslibpy
rosbridge-conformance client --copy-adapters .
rosbridge-conformance client --target roslibpy --run 'services/*' -- python roslibpy_adapter.py
