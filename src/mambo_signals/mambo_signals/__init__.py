"""Arrays in, arrays out: what is computed of recorded signals."""
