"""Vision: door plates, elevator markers and ceiling lights in camera images."""
