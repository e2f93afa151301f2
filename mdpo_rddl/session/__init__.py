"""Planning sessions, from a request to a summary and a run folder."""

from mdpo_rddl.session.offline import plan
from mdpo_rddl.session.online import replan
from mdpo_rddl.session.requests import LoadRequest, PlanRequest, Reporter
from mdpo_rddl.session.saved import evaluate_saved

__all__ = ["LoadRequest", "PlanRequest", "Reporter", "evaluate_saved", "plan", "replan"]
