"""Tools for tests: strategies, random programs and frames, and comparisons of executors."""
