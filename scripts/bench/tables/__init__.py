"""The tables of `bench.py`, one module each: `add_arguments(parser)` and `run(args)`."""
