def serialize_message(message) -> bytes:
    return b"zero"
