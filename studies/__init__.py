"""The experiments of the thesis, reproduced: lists of runs, their results, and the published ones."""
