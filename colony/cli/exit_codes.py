"""The exit codes of all commands; 0 is success, warnings included."""

EXIT_ERRORS = 1
EXIT_MISUSE = 2
EXIT_UNDECIDED = 3
EXIT_INTERRUPTED = 130
