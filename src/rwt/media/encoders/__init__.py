"""From pixels to bytes: image and video encoders and their containers."""
