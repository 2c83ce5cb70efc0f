"""Pictures of kernels, and results side by side."""
