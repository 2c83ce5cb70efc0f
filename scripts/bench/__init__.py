"""What the benchmark program and the figures share: cases, metrics, processes, tables."""
