"""Why the position drifts where the height varies: mechanisms, what they predict, what flights say."""
