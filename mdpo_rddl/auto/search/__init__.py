"""What arms search with: adaptation, evolution, and populations played on the exact model."""
