"""The front end: text to typed program. lark is needed only to rebuild the parser's tables."""
