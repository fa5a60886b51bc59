"""Source texts, diagnostics, units and the wording of messages."""
