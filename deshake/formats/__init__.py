"""Photos in and out: a codec a file, transfer curves, RAW."""
