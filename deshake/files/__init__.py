"""Outputs that appear whole or not at all, and the ``.npz`` files between the stages."""
