"""The algorithms as printed in the thesis, to be compared with ours."""
