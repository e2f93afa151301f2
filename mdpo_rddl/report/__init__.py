"""What a run leaves behind: its policy, its figures and its folder."""
