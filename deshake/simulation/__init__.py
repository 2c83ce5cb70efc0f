"""Shaken photos with a known kernel."""
