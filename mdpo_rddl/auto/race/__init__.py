"""The race itself: which arms take part, and who works when."""
