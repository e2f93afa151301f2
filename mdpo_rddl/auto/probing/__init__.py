"""What the model says before anything is searched: units, bounds, chance, errors."""
