"""Why the position drifts where the height varies: mechanisms, and what flights say."""
