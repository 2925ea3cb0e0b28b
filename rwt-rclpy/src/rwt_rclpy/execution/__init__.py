"""What runs callbacks, and when: contexts, executors, callback groups, futures, signals."""
