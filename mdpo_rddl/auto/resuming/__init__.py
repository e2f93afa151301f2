"""What a race leaves for another process or another race, and how that begins with it."""
