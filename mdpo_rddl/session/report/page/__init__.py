"""The page `report.html`, made from what else is in a run folder."""
