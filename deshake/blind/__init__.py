"""One photo to its blur kernel."""
