"""The focal length and the distortion of the lens."""
