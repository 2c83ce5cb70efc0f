"""The linear maps of the paper: A f, A^T g, B w, B^T r and B^T B (Eqs. 7-9)."""
