"""Parts that every command line uses."""
