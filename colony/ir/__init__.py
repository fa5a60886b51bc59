"""The typed program: what the front end produces and every other stage consumes. Imports no parser."""
