"""Messages as bytes: JSON, CBOR, CDR and ROS 1's own form."""
