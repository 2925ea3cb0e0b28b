"""Cases of the suite, the rules they test, and the targets that are graded."""
