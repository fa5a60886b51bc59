"""Experiments: lists of runs, their results, and the comparison with the targets."""
