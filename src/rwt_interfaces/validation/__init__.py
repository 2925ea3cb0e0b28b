"""Whether a value fits its type: lenient decoding, numbers, and how a mismatch is described."""
