"""Plans of stages: files in, files out."""
