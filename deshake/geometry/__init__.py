"""Cameras, rotations, and the blur kernel over rotations (Secs. 2 and 7)."""
