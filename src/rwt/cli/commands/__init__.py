"""Commands of `rwt`, one module each."""
