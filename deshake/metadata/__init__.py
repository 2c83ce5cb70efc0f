"""EXIF, XMP, IPTC and ICC: blocks of bytes that are carried, and never rewritten."""
