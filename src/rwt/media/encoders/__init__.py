"""Image and video encoders, and their containers."""
