"""What is read from and written to a terminal: messages, YAML, keys and logs."""
