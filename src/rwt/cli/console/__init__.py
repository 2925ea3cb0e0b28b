"""Input and output of the command line: messages, YAML, keys and logs."""
