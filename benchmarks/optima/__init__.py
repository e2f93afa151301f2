"""Which problems exact dynamic programming solves, and what their optimum is."""
