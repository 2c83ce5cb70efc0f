"""Many photos: search, plan, and work in parallel processes or on a cluster."""
