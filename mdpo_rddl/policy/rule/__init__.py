"""A lifted rule in words: its terms, how large they are, and what they are worth."""
