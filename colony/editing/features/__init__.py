"""What the server answers, a kind of request a file: functions of a document and the last index of it."""
