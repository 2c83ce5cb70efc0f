"""The door: one module a command, which parses, calls one pipeline function and reports."""
