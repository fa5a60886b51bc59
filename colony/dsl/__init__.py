"""The front end: text to typed program. The only place that knows lark."""
