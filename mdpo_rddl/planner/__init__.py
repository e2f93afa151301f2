"""The one folder that touches JaxPlan: its import, its hooks and its configuration files."""
