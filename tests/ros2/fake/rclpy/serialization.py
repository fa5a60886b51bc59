def serialize_message(message) -> bytes:
    return b"zero"


def deserialize_message(data, class_) -> bytes:
    if data == b"damaged":
        raise RuntimeError("damaged")
    return data
