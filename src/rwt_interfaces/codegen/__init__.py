"""Types for Python and TypeScript, made from definitions."""
