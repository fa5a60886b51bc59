"""What developers of colony run beside the tests: `python -m tools.NAME`."""
