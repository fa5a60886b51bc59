"""Back ends of the compiler: the client table, its explanation, JSON and Python."""
