"""What the recorder keeps in mind besides the messages: times, and what is missing."""
