"""What the exit codes of all commands mean; 0 is good, warnings included."""

EXIT_ERRORS = 1
EXIT_MISUSE = 2
EXIT_UNDECIDED = 3
EXIT_INTERRUPTED = 130
