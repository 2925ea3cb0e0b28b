"""Who may do what: admission, credentials, roles, quotas, origins, TLS and the audit log."""
