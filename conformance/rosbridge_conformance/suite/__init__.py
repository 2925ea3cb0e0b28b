"""Cases of the suite, the rules that they test, and the graded targets."""
