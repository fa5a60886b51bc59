"""The language server: protocol, documents, the session, and the processes that analyze and prove."""
