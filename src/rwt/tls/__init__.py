"""How connections are encrypted: certificates from files, or of the machine's own making."""
