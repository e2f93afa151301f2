"""How much an episode could have returned, had its random numbers been known before."""
