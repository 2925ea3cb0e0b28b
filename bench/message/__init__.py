"""Cost of one message within a process: validation, completion, recording, and blocking of the loop."""
