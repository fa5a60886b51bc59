"""The Python client library: calls to the servers of a robot from scripts and programs."""
