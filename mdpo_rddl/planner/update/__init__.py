"""One update of the parameters: analysis, noise, restarts, calls of several iterations."""
