"""The compiler: from the typed program to clients with guards, and from those to code."""
