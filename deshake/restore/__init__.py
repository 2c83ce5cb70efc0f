"""From a photo and its kernel to the sharp photo."""
