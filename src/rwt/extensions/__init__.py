"""Extensions: one folder each, which can be understood, replaced or removed alone."""
