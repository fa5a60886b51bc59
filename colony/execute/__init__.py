"""Executors of compiled programs, and the compiled form that they run."""
