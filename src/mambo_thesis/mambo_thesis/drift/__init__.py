"""Why the position drifts where the height varies: candidate mechanisms, and tests on flights."""
