"""The typed program: the output of the front end and the input of every other stage. Imports no parser."""
