"""Testing tools: strategies, random programs and frames, and comparisons of executors."""
