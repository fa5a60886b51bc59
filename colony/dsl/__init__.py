"""The front end: text to typed program."""
