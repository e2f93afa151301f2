"""Planning sessions, from a request to a summary and a run folder."""
