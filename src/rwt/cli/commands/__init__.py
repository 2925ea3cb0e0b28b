"""The commands of `rwt`, a module each."""
