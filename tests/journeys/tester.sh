# docs/how-to/conformance.md: grade a server.
server rwt serve ws://127.0.0.1:9090
rosbridge-conformance ws://127.0.0.1:9090 --run 'services/*' --run 'status/*' --html report.html
echo '[expected_failures]' > known.toml
echo '"services/no-such-case" = "a typing error"' >> known.toml
fails rosbridge-conformance ws://127.0.0.1:9090 --expect known.toml
