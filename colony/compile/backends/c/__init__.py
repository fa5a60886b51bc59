"""The backend that generates C99."""
