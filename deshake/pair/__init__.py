"""Two photos of a scene, one blurred and one noisy: registration, kernel, sharp photo (Sec. 6)."""
