"""Policies, plans and beliefs on the exact model, compiled: many side by side, no relaxation."""
