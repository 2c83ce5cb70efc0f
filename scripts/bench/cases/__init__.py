"""Photos with a known shake, and where their scenes and paths come from."""
