"""Drivers of real robots on serial lines: links, codecs, the guard of a port, and the base kernel."""
