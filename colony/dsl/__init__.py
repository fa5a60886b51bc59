"""The front end: text to typed program. lark builds its tables, and is not needed to read a text."""
