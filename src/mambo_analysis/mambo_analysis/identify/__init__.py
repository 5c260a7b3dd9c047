"""Parameters of vehicle and sensors from recordings, each as a command with its interval."""
