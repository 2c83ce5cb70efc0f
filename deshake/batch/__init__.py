"""Many photos: found, planned, and worked on at once in processes or on a cluster."""
