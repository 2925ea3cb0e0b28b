"""The pytest plugin: a robot, a server and a clock for tests. Nothing heavy is imported before a test asks."""
