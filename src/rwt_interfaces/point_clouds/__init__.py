"""Point clouds as records, and compressed. Needs numpy, and the extra `clouds` to compress."""
