"""Estimators of the blur kernel."""
