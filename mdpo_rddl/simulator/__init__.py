"""The exact model, many episodes side by side, on numpy alone."""
