"""A photo and its kernel give the sharp photo."""
