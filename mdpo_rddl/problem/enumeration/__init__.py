"""The reachable states of a small discrete problem, and exactly what follows each of them."""
