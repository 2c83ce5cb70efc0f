"""The door: one module a command, which parses, calls one function and reports."""
