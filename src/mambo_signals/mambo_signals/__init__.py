"""Functions on recorded signals, from arrays to arrays."""
