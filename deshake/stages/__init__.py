"""The stages from photos to the sharp photo: files in, files out."""
