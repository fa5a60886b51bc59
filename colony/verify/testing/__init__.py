"""Testing tools: strategies, random frames, and comparisons of executors."""
